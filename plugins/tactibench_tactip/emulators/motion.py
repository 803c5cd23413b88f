"""Poses as 4 x 4 matrices, and straight moves of the tool in time.

It is written apart from the drivers' own geometry: an emulator that shared that would share its
mistakes, and agree with them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

Array = npt.NDArray[np.float64]
Pose6 = tuple[float, float, float, float, float, float]
"""x, y, z mm; alpha, beta, gamma deg about the fixed x, y, z axes, in that order ("sxyz")."""

METRE = 1000.0
MM_PER_RADIAN = 200.0
"""Length that a turn of 1 rad counts as. The longer of this and the way of the tool point sets the
time of a move. The controllers' manuals give no figure; this is an assumption."""


def matrix(pose: Pose6) -> Array:
    """Return the (4, 4) transform of a pose, mm."""
    transform = np.eye(4)
    transform[:3, :3] = Rotation.from_euler("xyz", pose[3:], degrees=True).as_matrix()
    transform[:3, 3] = pose[:3]
    return transform


def pose6(transform: Array) -> Pose6:
    """Return the pose of a (4, 4) transform; where its angles are not unique, gamma is 0."""
    r = transform[:3, :3]
    cosine = math.hypot(r[0, 0], r[1, 0])
    beta = math.atan2(-r[2, 0], cosine)
    if cosine > 1e-9:
        alpha, gamma = math.atan2(r[2, 1], r[2, 2]), math.atan2(r[1, 0], r[0, 0])
    else:
        alpha, gamma = math.atan2(-r[1, 2], r[1, 1]), 0.0
    x, y, z = (float(value) for value in transform[:3, 3])
    return x, y, z, math.degrees(alpha), math.degrees(beta), math.degrees(gamma)


def inverse(transform: Array) -> Array:
    """Return the inverse of a (4, 4) rigid transform."""
    result = np.eye(4)
    result[:3, :3] = transform[:3, :3].T
    result[:3, 3] = -transform[:3, :3].T @ transform[:3, 3]
    return result


def from_ur(pose: npt.ArrayLike) -> Array:
    """Return the (4, 4) transform, mm, of a UR's pose (6,): metres and a rotation vector, rad."""
    values = np.asarray(pose, dtype=np.float64)
    transform = np.eye(4)
    transform[:3, :3] = Rotation.from_rotvec(values[3:]).as_matrix()
    transform[:3, 3] = values[:3] * METRE
    return transform


def to_ur(transform: Array) -> Array:
    """Return a UR's pose (6,), metres and a rotation vector, rad, of a (4, 4) transform, mm."""
    vector = Rotation.from_matrix(transform[:3, :3]).as_rotvec()
    return np.concatenate([transform[:3, 3] / METRE, vector])


@dataclass(frozen=True)
class Profile:
    """The way along a line against time: speed up, cruise, brake to rest.

    Attributes:
        peak: Speed of cruising, mm/s.
        acceleration: Acceleration of speeding up and of braking, mm/s2.
        rising: Time of speeding up from rest, s.
        cruising: Time at the peak, s.
    """

    peak: float
    acceleration: float
    rising: float = 0.0
    cruising: float = 0.0

    @classmethod
    def from_rest(cls, length: float, speed: float, acceleration: float) -> Self:
        """Return the fastest way over ``length`` mm from rest to rest.

        Over less than v^2 / a the speed is not reached: the peak is sqrt(a L).

        Args:
            length: L, mm.
            speed: Highest speed v, mm/s.
            acceleration: a, mm/s2.
        """
        if length <= 0:
            return cls(0.0, acceleration)
        peak = min(speed, math.sqrt(acceleration * length))
        cruising = max(0.0, length - peak * peak / acceleration) / peak
        return cls(peak, acceleration, peak / acceleration, cruising)

    @cached_property
    def seconds(self) -> float:
        """Time of the whole way, s."""
        return self.rising + self.cruising + self.peak / self.acceleration

    @cached_property
    def length(self) -> float:
        """Length of the whole way, mm."""
        return float(self.way(np.array(self.seconds)))

    def way(self, t: Array) -> Array:
        """Return the way, mm, at times ``t``, s since the start, of any shape."""
        up = np.clip(t, 0.0, self.rising)
        level = np.clip(t - self.rising, 0.0, self.cruising)
        down = np.clip(t - self.rising - self.cruising, 0.0, self.peak / self.acceleration)
        result: Array = (
            0.5 * self.acceleration * up**2
            + self.peak * (level + down)
            - 0.5 * self.acceleration * down**2
        )
        return result

    def speed(self, t: float) -> float:
        """Return the speed, mm/s, at ``t`` s since the start; it is 0 before and after the way."""
        if not 0.0 <= t < self.seconds:
            return 0.0
        braking = max(0.0, t - self.rising - self.cruising)
        return min(
            self.acceleration * t if t < self.rising else self.peak,
            self.peak - self.acceleration * braking,
        )


@dataclass(frozen=True, eq=False)
class Move:
    """A straight way between two poses, along which the tool turns about one axis.

    Attributes:
        start_s: Time of the world at the start, s.
        start: (4, 4) pose at the start of the line.
        end: (4, 4) pose at the end of the line.
        profile: Way along the line; the tool stops where it ends, also before the line's end.
    """

    start_s: float
    start: Array
    end: Array
    profile: Profile

    @classmethod
    def travel(cls, t: float, start: Array, end: Array, speed: float, acceleration: float) -> Self:
        """Return a move from rest to rest.

        Args:
            t: Time of the start, s.
            start: (4, 4) first pose.
            end: (4, 4) last pose.
            speed: Highest speed, mm/s.
            acceleration: Acceleration, mm/s2.
        """
        length = line_length(start, end)
        return cls(t, start, end, Profile.from_rest(length, speed, acceleration))

    @classmethod
    def rest(cls, t: float, pose: Array) -> Self:
        """Return the move of a tool that stands still at a (4, 4) pose from ``t`` s on."""
        return cls(t, pose, pose, Profile(0.0, 1.0))

    @property
    def end_s(self) -> float:
        """Time at which the tool comes to rest, s."""
        return self.start_s + self.profile.seconds

    @cached_property
    def length(self) -> float:
        """Length of the whole line, mm."""
        return line_length(self.start, self.end)

    @cached_property
    def _turn(self) -> Array:
        return _turn_between(self.start, self.end)

    def poses(self, times: Array) -> Array:
        """Return the poses (N, 4, 4) at times (N,) of the world, s."""
        ways = self.profile.way(np.asarray(times) - self.start_s)
        # The last step lands on the end itself, whatever rounding did on the way.
        shares = np.where(ways >= self.length * (1 - 1e-12), 1.0, ways / max(self.length, 1e-300))
        poses = np.broadcast_to(self.start, (len(shares), 4, 4)).copy()
        poses[:, :3, 3] += shares[:, None] * (self.end[:3, 3] - self.start[:3, 3])
        if self._turn.any():
            turns = Rotation.from_rotvec(shares[:, None] * self._turn).as_matrix()
            poses[:, :3, :3] = self.start[:3, :3] @ turns
        return poses

    def pose(self, t: float) -> Array:
        """Return the (4, 4) pose at ``t`` s of the world."""
        pose: Array = self.poses(np.array([t]))[0]
        return pose

    def speed(self, t: float) -> float:
        """Return the speed along the line, mm/s, at ``t`` s of the world."""
        return self.profile.speed(t - self.start_s)

    def braked(self, t: float, deceleration: float) -> Move:
        """Return the move that comes to rest on the same line.

        Args:
            t: Time at which braking begins, s.
            deceleration: Deceleration, mm/s2; it is greater where the line is too short.
        """
        pose, speed = self.pose(t), self.speed(t)
        left = line_length(pose, self.end)
        if speed <= 0 or left <= 0:
            return Move.rest(t, pose)
        return Move(t, pose, self.end, Profile(speed, max(deceleration, speed**2 / (2 * left))))


def line_length(start: Array, end: Array) -> float:
    """Return the way of the tool point, mm, or the length of its turn where that is longer."""
    way = float(np.linalg.norm(end[:3, 3] - start[:3, 3]))
    return max(way, float(np.linalg.norm(_turn_between(start, end))) * MM_PER_RADIAN)


def _turn_between(start: Array, end: Array) -> Array:
    """Return the rotation vector (3,), rad; it is zero where rounding alone turns the tool."""
    if np.array_equal(start[:3, :3], end[:3, :3]):
        return np.zeros(3)
    vector: Array = Rotation.from_matrix(start[:3, :3].T @ end[:3, :3]).as_rotvec()
    return vector if np.linalg.norm(vector) > 1e-9 else np.zeros(3)
