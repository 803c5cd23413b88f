"""Closed-form contact geometry of spherical tips and plates on a spherical dome or a flat pad.

With R_d the dome's radius, R the tip's and rho the distance of the tip's axis from the dome's, a
tip first touches when its centre is at height sqrt((R_d + R)^2 - rho^2) above the dome's centre. A
flat pad is a dome of infinite radius: every tip touches on its own axis, at its own height.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Contacts, FloatArray, Indenter, PlatePose, Pose, Scene
from tactibench.errors import UserError

DOME_RADIUS_MM = 20.0
"""Radius of the nominal dome."""


def tip_positions(scene: Scene) -> FloatArray:
    """Return (K, 3) x, y and height offset of every tip's axis in the sensor frame, mm."""
    tips: FloatArray = np.array(scene.indenter.offsets, dtype=np.float64)
    yaw = math.radians(scene.pose.yaw)
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    tips[:, :2] = tips[:, :2] @ turn.T + [scene.pose.x, scene.pose.y]
    return tips


def tip_depths(scene: Scene, dome_radius: float = DOME_RADIUS_MM) -> FloatArray:
    """Return the (K,) travel of every tip past its own first touch, mm.

    Where it is zero or less, the tip does not touch. Tips whose axis passes beside the dome
    (rho >= R_d + R) get minus infinity. A plate has one "tip" with the depth of its pose.

    Args:
        scene: The press.
        dome_radius: Radius of the surface, mm; inf for a flat pad.
    """
    if scene.indenter.is_plate:
        return np.array([scene.pose.depth])
    touch = _first_touch(scene, dome_radius)
    if not np.isfinite(touch).any():
        return touch
    depth: FloatArray = scene.pose.depth - (touch.max() - touch)
    return depth


def _first_touch(scene: Scene, dome_radius: float) -> FloatArray:
    """Return the (K,) height at which every tip first touches, up to a common constant, mm."""
    tips = tip_positions(scene)
    if math.isinf(dome_radius):
        return tips[:, 2]
    square = (dome_radius + scene.indenter.radius) ** 2 - (tips[:, :2] ** 2).sum(axis=1)
    touch = np.full(len(tips), -np.inf)
    inside = square > 0
    touch[inside] = np.sqrt(square[inside]) + tips[inside, 2]
    return touch


def scene_of_contacts(
    xy: FloatArray, depth: FloatArray, radius: float, dome_radius: float = DOME_RADIUS_MM
) -> Scene:
    """Return the press by one holder of K tips that has given contacts.

    ``true_contacts`` of this press are the given contacts. The lowest tip has height 0; two tips
    lie along the holder's x axis.

    Args:
        xy: (K, 2) axis of every tip, mm.
        depth: (K,) travel of every tip past its own first touch, mm.
        radius: Radius of every tip, mm.
        dome_radius: Radius of the surface, mm.

    Raises:
        ValueError: A contact lies beside the dome.
    """
    if len(xy) == 1:
        return Scene(
            Indenter.single(radius),
            Pose(float(xy[0, 0]), float(xy[0, 1]), depth=float(depth[0])),
        )
    middle, yaw = xy.mean(axis=0), 0.0
    away = xy - middle
    if len(xy) == 2:
        half = math.dist(xy[0], xy[1]) / 2
        yaw = math.degrees(math.atan2(*(xy[1] - xy[0])[::-1]))
        away = np.array([[-half, 0.0], [half, 0.0]])
    pose = Pose(float(middle[0]), float(middle[1]), yaw, depth=float(depth.max()))
    name = {2: "dual", 3: "triple"}.get(len(xy), "tips")

    def press(heights: FloatArray) -> Scene:
        rows = np.column_stack([away, heights]).tolist()
        return Scene(Indenter(radius, tuple((x, y, z) for x, y, z in rows), name), pose)

    level = _first_touch(press(np.zeros(len(xy))), dome_radius)
    if not np.isfinite(level).all():
        beside = xy[np.flatnonzero(~np.isfinite(level))[0]]
        raise ValueError(f"the contact at x {beside[0]:g}, y {beside[1]:g} mm lies beside the dome")
    heights = depth - level
    return press(heights - heights.min())


def true_contacts(
    scene: Scene, dome_radius: float = DOME_RADIUS_MM, force: npt.ArrayLike | None = None
) -> Contacts:
    """Return the contacts of a scene; a tip that does not touch has no contact.

    A plate touches at ``dome_radius * sin(tilt)`` along its tilt axis with the depth of the pose.

    Args:
        scene: The press.
        dome_radius: Radius of the surface, mm; inf for a flat pad.
        force: (N, 3) forces of the contacts, N; None: not known.

    Raises:
        UserError: The indenter is a plate and the surface a flat pad, which it touches everywhere.
    """
    if scene.indenter.is_plate:
        xy, deep = [plate_contact_xy(scene, dome_radius)], scene.pose.depth
        return Contacts.truth(xy, [deep], force) if deep > 0 else Contacts.none()
    depth = tip_depths(scene, dome_radius)
    touching = ~(depth <= 0)  # also where the depth is not known, NaN
    return Contacts.truth(tip_positions(scene)[touching, :2], depth[touching], force)


def plate_contact_xy(scene: Scene, dome_radius: float = DOME_RADIUS_MM) -> tuple[float, float]:
    """Return (x, y) mm where a tilted plate meets the dome: dome_radius * sin(tilt) along the yaw.

    Raises:
        UserError: The surface is a flat pad.
    """
    _refuse_flat(dome_radius)
    offset = dome_radius * math.sin(math.radians(scene.pose.tilt))
    yaw = math.radians(scene.pose.yaw)
    return offset * math.cos(yaw), offset * math.sin(yaw)


def plate_pose(scene: Scene) -> PlatePose:
    """Return the true plate pose of a scene."""
    return PlatePose(scene.pose.depth, scene.pose.tilt)


def plate_from_contacts(
    contacts: Contacts, dome_radius: float = DOME_RADIUS_MM
) -> PlatePose | None:
    """Return the plate of the best contact: tilt = asin(x / dome_radius); None without a contact.

    Raises:
        UserError: The surface is a flat pad.
    """
    _refuse_flat(dome_radius)
    if not len(contacts):
        return None
    sine = float(np.clip(contacts.xy[0, 0] / dome_radius, -1.0, 1.0))
    return PlatePose(float(contacts.depth[0]), math.degrees(math.asin(sine)))


def _refuse_flat(dome_radius: float) -> None:
    if math.isinf(dome_radius):
        raise UserError(
            "a plate touches a flat pad everywhere and has no point of contact there; press "
            "spherical tips, or take a sensor with a dome."
        )
