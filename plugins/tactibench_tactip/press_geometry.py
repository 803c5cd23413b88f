"""A press on the dome as a pose of the tool, and back.

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

from tactibench import Pose, Scene
from tactibench.geometry import tip_positions
from tactibench_tactip.poses import Array, about_z, inverse, matrix, pose_of
from tactibench_tactip.settings import FrameSettings, Pose6, Settings

_FLIP = matrix((0.0, 0.0, 0.0, 180.0, 0.0, 0.0))


@dataclass(frozen=True)
class PressGeometry:
    """The geometry of one setup.

    Attributes:
        frames: The part that moves, and the place of the sensor.
        dome_radius: Radius of the dome, mm; inf: a flat pad.
        z0: Place of first touch along the work frame's z, mm.
    """

    frames: FrameSettings
    dome_radius: float = 20.0
    z0: float = 0.0

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


def geometry_of(settings: Settings) -> PressGeometry:
    """Return the geometry of a setup before first touch was searched."""
    return PressGeometry(settings.frames, settings.sensor.dome_radius_mm, settings.contact.fixed_mm)


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
