"""Poses, and a press on the dome as a pose of the tool, and back.

A pose is (x, y, z, alpha, beta, gamma), mm and deg, extrinsic sxyz, or a 4 x 4 matrix.

Frames, all right-handed, mm. S, the sensor: origin at the undeformed apex, x right and y down in
the image, z out of the dome. T, the indenter: z towards the sensor, origin at the foremost point of
a tip of height offset 0. An ``Indenter`` gives its tips as the camera sees them, (dx, dy) right and
down, dz towards the sensor: in T, whose z comes towards the camera, they are at (dx, -dy, dz).

With R_d the dome's radius, R the tip's and rho the distance of its axis from the dome's, the point
of tip k touches first at height sqrt((R_d + R)^2 - rho_k^2) - (R_d + R) <= 0 over the apex. It
reaches dz_k further than the indenter's origin, so that the indenter as a whole touches first at

    h = max_k (sqrt((R_d + R)^2 - rho_k^2) - (R_d + R) + dz_k)

and at depth d it stands at z = h - d: T in S is (x, y, h - d), turned by yaw about z and then by
180 deg about its own x. A plate of tilt t along yaw touches where its normal
n = (sin t cos yaw, sin t sin yaw, cos t) leaves the dome; it stands at n (R_d - d) from its centre.

The robot carries one of the two. W is the work frame, z into the object:

    the indenter moves   tool in W = (S in W) (T in S),    S in W = (x_s, y_s, z0) Rz(yaw_s) Rx(180)
    the sensor moves     tool in W = (T in W) (T in S)^-1 (S in tool)^-1,
                         T in W = (0, 0, z0) Rx(180),      S in tool = (x_s, y_s, 0) Rz(yaw_s)

``z0`` is where first touch was found, along the work frame's z: it takes up the unknown parts of
the tool's length and of the table.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from tactibench import Indenter, Pose, Scene
from tactibench.geometry import tip_positions
from tactibench_tactip.settings import EnvelopeSettings, FrameSettings, Pose6, Settings

Array = npt.NDArray[np.float64]

ROUNDING = 1e-3
"""Distance, mm, and angle, deg, by which rounding may take a pose out of the envelope."""
NEAR_MM = 1.0
"""Distance before first touch at which the slow descent begins."""


def matrix(pose: Pose6) -> Array:
    """Return the (4, 4) transform of a pose: R = Rz(gamma) Ry(beta) Rx(alpha)."""
    x, y, z, *angles = pose
    # Written out: each turn of the control loop needs some, and scipy takes five times as long.
    (sa, ca), (sb, cb), (sc, cc) = ((math.sin(r), math.cos(r)) for r in map(math.radians, angles))
    rows = (
        (cb * cc, sa * sb * cc - ca * sc, ca * sb * cc + sa * sc, x),
        (cb * sc, sa * sb * sc + ca * cc, ca * sb * sc - sa * cc, y),
        (-sb, sa * cb, ca * cb, z),
        (0.0, 0.0, 0.0, 1.0),
    )
    return np.array(rows)


def pose_of(transform: Array) -> Pose6:
    """Return the pose of a (4, 4) rigid transform, alpha and gamma in -180..180, beta in -90..90.

    At beta = +-90 alpha and gamma turn about the same line: alpha is the whole turn, gamma is 0.
    """
    m = transform.tolist()
    level = math.hypot(m[0][0], m[1][0])
    beta = math.atan2(-m[2][0], level)
    if level > 1e-9:
        alpha, gamma = math.atan2(m[2][1], m[2][2]), math.atan2(m[1][0], m[0][0])
    else:
        alpha, gamma = math.atan2(-m[1][2], m[1][1]), 0.0
    angles = (math.degrees(alpha), math.degrees(beta), math.degrees(gamma))
    return m[0][3], m[1][3], m[2][3], *angles


def inverse(transform: Array) -> Array:
    """Return the inverse of a (4, 4) rigid transform."""
    result = np.eye(4)
    result[:3, :3] = transform[:3, :3].T
    result[:3, 3] = -transform[:3, :3].T @ transform[:3, 3]
    return result


def about_z(degrees: float) -> Array:
    """Return the (4, 4) turn about z."""
    return matrix((0.0, 0.0, 0.0, 0.0, 0.0, degrees))


def to_ur(pose: Pose6) -> list[float]:
    """Return a pose in the form of a UR controller: x, y, z, m, and a rotation vector, rad."""
    turn = Rotation.from_matrix(matrix(pose)[:3, :3]).as_rotvec()
    return [*(0.001 * value for value in pose[:3]), *turn.tolist()]


def from_ur(pose: list[float]) -> Pose6:
    """Return the pose of a UR controller's numbers: x, y, z, m, and a rotation vector, rad."""
    transform = np.eye(4)
    transform[:3, :3] = Rotation.from_rotvec(pose[3:]).as_matrix()
    transform[:3, 3] = 1000.0 * np.asarray(pose[:3])
    return pose_of(transform)


def angle_between(a: Pose6, b: Pose6) -> float:
    """Return the angle between two orientations, deg."""
    turn_a, turn_b = (Rotation.from_euler("xyz", pose[3:], degrees=True) for pose in (a, b))
    return math.degrees((turn_a.inv() * turn_b).magnitude())


def distance_between(a: Pose6, b: Pose6) -> float:
    """Return the distance between two positions, mm."""
    return math.dist(a[:3], b[:3])


def envelope_violation(limits: EnvelopeSettings, pose: Pose6, start: Pose6 = (0.0,) * 6) -> str:
    """Return a clause about how a pose in the work frame leaves the envelope, "" inside it.

    Comparisons are written so that NaN fails them. A software limit is no safety function: it
    catches mistakes of a configuration, not of a controller.

    Args:
        limits: The envelope.
        pose: The pose.
        start: Pose from where the tool comes. Where that lies outside, the way back is free: only
            what leads farther out is a violation.
    """
    wide, above, below = limits.half_width_mm, limits.above_mm, limits.below_mm
    most = (wide, wide, above, below, limits.yaw_deg, limits.tilt_deg)
    limited = zip(_LIMITS, most, _limited(pose), _limited(start), strict=True)
    for (name, key, low, high), limit, value, at in limited:
        unit = key.rpartition("_")[2]
        # The limit first: min and max then leave out a start of NaN.
        if not min(low * limit, at) - ROUNDING <= value <= max(high * limit, at) + ROUNDING:
            return f"{name} {value:.2f} {unit}, where envelope.{key} allows {limit:g} {unit}"
    return ""


_LIMITS = (
    ("x of the work frame", "half_width_mm", -1.0, 1.0),
    ("y of the work frame", "half_width_mm", -1.0, 1.0),
    ("z of the work frame", "above_mm", -1.0, math.inf),
    ("z of the work frame", "below_mm", -math.inf, 1.0),
    ("a yaw of", "yaw_deg", -1.0, 1.0),
    ("a tilt of", "tilt_deg", -1.0, 1.0),
)
"""Name of a limited value, its limit, and the factors of that for the least and greatest value."""


def _limited(pose: Pose6) -> tuple[float, ...]:
    """Return the values that _LIMITS names."""
    x, y, z, _, _, yaw = pose
    tilt = math.degrees(math.acos(np.clip(matrix(pose)[2, 2], -1.0, 1.0)))
    return x, y, z, z, yaw, tilt


_FLIP = matrix((0.0, 0.0, 0.0, 180.0, 0.0, 0.0))


@dataclass(frozen=True)
class PressPath:
    """The poses of one press in the work frame.

    Attributes:
        above: Pose at clearance.
        near: Pose before first touch, where the slow descent begins.
        down: Pose at the depth of the press.
    """

    above: Pose6
    near: Pose6
    down: Pose6


@dataclass(frozen=True)
class PressGeometry:
    """The geometry of one setup.

    Attributes:
        frames: The part that moves, and the place of the sensor.
        dome_radius: Radius of the dome, mm; inf: a flat pad.
        z0: Place of first touch along the work frame's z, mm.
        clearance: Distance before first touch at which all sideways motion is made, mm.
        longest: Distance by which the longest tip of the mounted indenter reaches ahead, mm.
    """

    frames: FrameSettings
    dome_radius: float = 20.0
    z0: float = 0.0
    clearance: float = 10.0
    longest: float = 0.0

    @property
    def clear_height(self) -> float:
        """Height (z of the work frame, mm) at which the mounted indenter is clear of the apex."""
        return self.z0 - self.longest - self.clearance

    def clear_depth(self, scene: Scene) -> float:
        """Return the negative depth at which the whole indenter is at clearance over the apex."""
        if scene.indenter.is_plate:
            return -self.clearance
        longest = max(offset[2] for offset in scene.indenter.offsets)
        return touch_height(scene, self.dome_radius) - longest - self.clearance

    def path(self, scene: Scene) -> PressPath:
        """Return the path of a press: it moves sideways only above, at one height everywhere."""
        return PressPath(
            self.at_depth(scene, self.clear_depth(scene)),
            self.at_depth(scene, min(-NEAR_MM, scene.pose.depth)),
            self.tool_pose(scene),
        )

    def with_z0(self, z0: float) -> PressGeometry:
        """Return the same geometry with another place of first touch, mm."""
        return replace(self, z0=z0)

    def tool_pose(self, scene: Scene) -> Pose6:
        """Return the tool's pose in the work frame; a negative depth lies before first touch."""
        in_sensor = indenter_in_sensor(scene, self.dome_radius)
        if self.frames.moves == "indenter":
            return pose_of(self._sensor_in_work @ in_sensor)
        return pose_of(self._indenter_in_work @ inverse(in_sensor) @ inverse(self._sensor_in_tool))

    def at_depth(self, scene: Scene, depth: float) -> Pose6:
        """Return the tool's pose on the press's own approach, at another depth, mm."""
        return self.tool_pose(replace(scene, pose=replace(scene.pose, depth=depth)))

    def reached(self, scene: Scene, tool: Pose6) -> Scene:
        """Return the planned scene with the pose that a tool in the work frame really presses."""
        in_work = matrix(tool)
        if self.frames.moves == "indenter":
            in_sensor = inverse(self._sensor_in_work) @ in_work
        else:
            in_sensor = inverse(in_work @ self._sensor_in_tool) @ self._indenter_in_work
        return replace(scene, pose=pose_in_sensor(scene, in_sensor, self.dome_radius))

    @cached_property
    def _sensor_in_work(self) -> Array:
        x, y, yaw = self.frames.sensor
        return matrix((x, y, self.z0, 0.0, 0.0, 0.0)) @ about_z(yaw) @ _FLIP

    @cached_property
    def _sensor_in_tool(self) -> Array:
        x, y, yaw = self.frames.sensor
        return matrix((x, y, 0.0, 0.0, 0.0, 0.0)) @ about_z(yaw)

    @cached_property
    def _indenter_in_work(self) -> Array:
        return matrix((0.0, 0.0, self.z0, 180.0, 0.0, 0.0))


def geometry_of(settings: Settings, mounted: Indenter | None = None) -> PressGeometry:
    """Return the geometry of a setup before first touch was searched.

    Args:
        settings: Configuration of the setup.
        mounted: The mounted indenter; None: that of the configuration.
    """
    mounted = mounted or settings.indenter.indenter()
    return PressGeometry(
        settings.frames,
        settings.sensor.dome_radius_mm,
        settings.contact.fixed_mm,
        settings.envelope.clearance_mm,
        max(offset[2] for offset in mounted.offsets),
    )


def touch_height(scene: Scene, dome_radius: float) -> float:
    """Return h, the indenter's height over the apex at first touch, mm; -inf: beside the dome."""
    tips = tip_positions(scene)
    if math.isinf(dome_radius):
        return float(tips[:, 2].max())
    reach = dome_radius + scene.indenter.radius
    square = reach**2 - (tips[:, :2] ** 2).sum(axis=1)
    inside = square > 0
    heights = np.full(len(tips), -np.inf)
    heights[inside] = np.sqrt(square[inside]) - reach + tips[inside, 2]
    return float(heights.max())


def indenter_in_sensor(scene: Scene, dome_radius: float) -> Array:
    """Return the (4, 4) transform of T in S for a press."""
    pose = scene.pose
    if scene.indenter.is_plate:
        turn = about_z(pose.yaw) @ matrix((0, 0, 0, 0, pose.tilt, 0)) @ about_z(-pose.yaw)
        centre = np.array([0.0, 0.0, -dome_radius])
        plate = turn @ _FLIP
        plate[:3, 3] = centre + (dome_radius - pose.depth) * turn[:3, 2]
        return plate
    tips = about_z(pose.yaw) @ _FLIP
    tips[:3, 3] = pose.x, pose.y, touch_height(scene, dome_radius) - pose.depth
    return tips


def pose_in_sensor(scene: Scene, in_sensor: Array, dome_radius: float) -> Pose:
    """Return the pose of a transform, as the inverse of ``indenter_in_sensor``.

    Args:
        scene: Scene that gives the indenter, and a plate's yaw.
        in_sensor: (4, 4) transform of T in S.
        dome_radius: Radius of the dome, mm.
    """
    if scene.indenter.is_plate:
        yaw = math.radians(scene.pose.yaw)
        normal = -in_sensor[:3, 2]
        along = float(normal[0] * math.cos(yaw) + normal[1] * math.sin(yaw))
        from_centre = in_sensor[:3, 3] + [0.0, 0.0, dome_radius]
        return replace(
            scene.pose,
            tilt=math.degrees(math.atan2(along, float(normal[2]))),
            depth=dome_radius - float(normal @ from_centre),
        )
    x, y, z = (float(value) for value in in_sensor[:3, 3])
    yaw = math.degrees(math.atan2(in_sensor[1, 0], in_sensor[0, 0]))
    turns = round((scene.pose.yaw - yaw) / 360.0)  # as the plan counts them
    pose = replace(scene.pose, x=x, y=y, yaw=yaw + 360.0 * turns)
    return replace(pose, depth=touch_height(replace(scene, pose=pose), dome_radius) - z)
