"""Poses as 4 x 4 matrices, and straight moves of the tool in time.

Written apart from the drivers' own geometry: an emulator that shared it would share its mistakes,
and agree with them.
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
"""Length that a turn counts as, beside the way of the tool point: the longer of the two sets the
time. The controllers' manuals give no figure; this is an assumption."""


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
    """Return the (4, 4) transform, mm, of metres and a rotation vector, rad."""
    values = np.asarray(pose, dtype=np.float64)
    transform = np.eye(4)
    transform[:3, :3] = Rotation.from_rotvec(values[3:]).as_matrix()
    transform[:3, 3] = values[:3] * METRE
    return transform


def to_ur(transform: Array) -> Array:
    """Return (6,) metres and rotation vector of a transform in mm."""
    vector = Rotation.from_matrix(transform[:3, :3]).as_rotvec()
    return np.concatenate([transform[:3, 3] / METRE, vector])


@dataclass(frozen=True)
class Profile:
    """Way along a line against time: speed up, cruise at ``peak`` mm/s, brake to rest.

    Args:
        rising: seconds of speeding up from rest with ``acceleration``.
        cruising: seconds at the peak.
        acceleration: mm/s2, also of the braking.
    """

    peak: float
    acceleration: float
    rising: float = 0.0
    cruising: float = 0.0

    @classmethod
    def from_rest(cls, length: float, speed: float, acceleration: float) -> Self:
        """Return the fastest way over ``length`` mm from rest to rest.

        Over less than v^2 / a the speed is not reached: the peak is sqrt(a L).
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
        """Return mm after t s since the start, any shape."""
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
        """Return mm/s after t s; 0 before and after."""
        if not 0.0 <= t < self.seconds:
            return 0.0
        braking = max(0.0, t - self.rising - self.cruising)
        return min(
            self.acceleration * t if t < self.rising else self.peak,
            self.peak - self.acceleration * braking,
        )


@dataclass(frozen=True, eq=False)
class Move:
    """A straight way between two (4, 4) poses from ``start_s`` on; the tool turns about one axis.

    A profile that ends before the line does stops there.
    """

    start_s: float
    start: Array
    end: Array
    profile: Profile

    @classmethod
    def travel(cls, t: float, start: Array, end: Array, speed: float, acceleration: float) -> Self:
        """Return a move from rest to rest; mm/s, mm/s2."""
        length = line_length(start, end)
        return cls(t, start, end, Profile.from_rest(length, speed, acceleration))

    @classmethod
    def rest(cls, t: float, pose: Array) -> Self:
        """Return a tool that stands still from t on."""
        return cls(t, pose, pose, Profile(0.0, 1.0))

    @property
    def end_s(self) -> float:
        """When it comes to rest, s."""
        return self.start_s + self.profile.seconds

    @cached_property
    def length(self) -> float:
        """Length of the whole line, mm."""
        return line_length(self.start, self.end)

    @cached_property
    def _turn(self) -> Array:
        return _turn_between(self.start, self.end)

    def poses(self, times: Array) -> Array:
        """Return (N, 4, 4) poses at (N,) s of the world."""
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
        """Return the (4, 4) pose at t s."""
        pose: Array = self.poses(np.array([t]))[0]
        return pose

    def speed(self, t: float) -> float:
        """Return mm/s along the line at t s."""
        return self.profile.speed(t - self.start_s)

    def braked(self, t: float, deceleration: float) -> Move:
        """Return the move that comes to rest on the same line from t on; mm/s2.

        It brakes harder where the line is too short.
        """
        here, speed = self.pose(t), self.speed(t)
        left = line_length(here, self.end)
        if speed <= 0 or left <= 0:
            return Move.rest(t, here)
        return Move(t, here, self.end, Profile(speed, max(deceleration, speed**2 / (2 * left))))


def line_length(start: Array, end: Array) -> float:
    """Return mm of the tool point's way, or of the turn where that is longer."""
    way = float(np.linalg.norm(end[:3, 3] - start[:3, 3]))
    return max(way, float(np.linalg.norm(_turn_between(start, end))) * MM_PER_RADIAN)


def _turn_between(start: Array, end: Array) -> Array:
    """Rotation vector (3,), rad, zero below what rounding makes."""
    if np.array_equal(start[:3, :3], end[:3, :3]):
        return np.zeros(3)
    vector: Array = Rotation.from_matrix(start[:3, :3].T @ end[:3, :3]).as_rotvec()
    return vector if np.linalg.norm(vector) > 1e-9 else np.zeros(3)
