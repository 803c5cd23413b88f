"""The arm: poses of flange and TCP in the base frame, and moves of the world's tool."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactibench_tactip.emulators.motion import Line, Profile, braking, trapezoid
from tactibench_tactip.emulators.poses import METRE, Array, Pose6, from_ur, inverse, matrix, to_ur
from tactibench_tactip.emulators.ur import kinematics
from tactibench_tactip.emulators.world import World

STEADY_S = 0.5
"""World seconds without motion after which ``is_steady`` holds (URScript manual)."""
HALT_MM_S2 = 5000.0
"""Deceleration of a stop that the controller makes itself (assumed)."""
FARTHEST_MM = 1000.0
"""A move without a target ends there, where a real arm is out of reach."""


class Arm:
    """tool: where the world's tool point is on the flange; tcp: what the controller believes."""

    def __init__(self, world: World, tool: Pose6, tcp: Pose6) -> None:
        self.world = world
        self._base = matrix(world.rig.work_frame)
        self._to_work = inverse(self._base)
        self._tool = matrix(tool)
        self.tcp = matrix(tcp)
        self._joints = np.array(kinematics.START)
        self._joints_for: Array | None = None

    def flange(self, t: float) -> Array:
        """(4, 4) mm, base frame."""
        return np.asarray(self._base @ self.world.pose_at(t) @ inverse(self._tool))

    def pose(self, t: float) -> Array:
        """(6,) of the TCP, m and rotation vector."""
        return to_ur(self.flange(t) @ self.tcp)

    def velocity(self, t: float) -> Array:
        """(6,) of the TCP, m/s; the turning is not worked out."""
        speed, way = self.world.speed(t)
        return np.concatenate([self._base[:3, :3] @ way * speed / METRE, np.zeros(3)])

    def force(self, t: float) -> Array:
        """(6,) N on the TCP in the base frame, away from the sensor; no torques."""
        away = (self._base @ matrix(self.world.rig.sensor_frame))[:3, 2]
        return np.concatenate([away * self.world.force(t), np.zeros(3)])

    def joints(self, t: float) -> Array:
        """(6,) rad; the latest ones where the arm cannot reach its pose."""
        flange = self.flange(t)
        if self._joints_for is None or not np.array_equal(flange, self._joints_for):
            found = kinematics.joints(flange, self._joints)
            self._joints = self._joints if found is None else found
            self._joints_for = flange
        return self._joints

    def reachable(self, pose: Sequence[float]) -> Array | None:
        """(6,) joints for a TCP pose (m, rotation vector), None: there are none."""
        return kinematics.joints(from_ur(pose) @ inverse(self.tcp), self._joints)

    def moving(self, t: float) -> bool:
        return t < self.world.still_s

    def steady(self, t: float) -> bool:
        return t >= self.world.still_s + STEADY_S

    def move(self, t: float, pose: Sequence[float], speed: float, acceleration: float) -> None:
        """A straight way to a TCP pose; m, rad, m/s, m/s2. What moves is braked first."""
        self._go(t, from_ur(pose) @ inverse(self.tcp), speed, acceleration)

    def move_joints(self, t: float, q: Sequence[float], speed: float, acceleration: float) -> None:
        """To joint angles, rad, rad/s, rad/s2. The way there is straight, not that of the joints;
        a radian counts as 0.2 m."""
        share = 0.2
        self._go(t, kinematics.flange(np.array(q)), speed * share, acceleration * share)

    def push(self, t: float, velocity: Sequence[float], acceleration: float) -> None:
        """A straight way at a velocity (m/s, base frame) until something stops it."""
        speed = np.array(velocity[:3])
        length = float(np.linalg.norm(speed))
        if length == 0:
            self.stop(t, acceleration)
            return
        target = self.flange(t)
        target[:3, 3] += speed / length * FARTHEST_MM
        self._go(t, target, length, acceleration)

    def stop(self, t: float, deceleration: float) -> None:
        """Brake on the way; m/s2."""
        self.world.follow(t, self._braking(t, deceleration * METRE))

    def halt(self, t: float) -> None:
        """Stop as the controller does by itself."""
        self.world.follow(t, self._braking(t, HALT_MM_S2))

    def _braking(self, t: float, deceleration: float) -> list[tuple[Array, Profile]]:
        leg = self.world.leg(t)
        if leg is None:
            return []
        speed, left = leg.speed(t), leg.profile.way - leg.way(t)
        if deceleration <= 0 or speed * speed > 2 * deceleration * left:
            deceleration = speed * speed / (2 * left) if left > 0 else np.inf
        return [(leg.line.end, braking(speed, deceleration))] if np.isfinite(deceleration) else []

    def _go(self, t: float, flange: Array, speed: float, acceleration: float) -> None:
        steps = self._braking(t, acceleration * METRE)
        here = self.world.pose_at(t)
        for target, profile in steps:
            here = Line(here, target).at(profile.way)
        end = self._to_work @ flange @ self._tool
        profile = trapezoid(Line(here, end).length, speed * METRE, acceleration * METRE)
        self.world.follow(t, [*steps, (end, profile)])
