"""Poses as (x, y, z, alpha, beta, gamma), mm and deg, extrinsic sxyz, and as 4 x 4 matrices."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from tactibench_tactip.settings import Pose6

Array = npt.NDArray[np.float64]


def matrix(pose: Pose6) -> Array:
    """(4, 4) of a pose: R = Rz(gamma) Ry(beta) Rx(alpha)."""
    ca, cb, cc = (math.cos(math.radians(angle)) for angle in pose[3:])
    sa, sb, sc = (math.sin(math.radians(angle)) for angle in pose[3:])
    return np.array(
        [
            [cc * cb, cc * sb * sa - sc * ca, cc * sb * ca + sc * sa, pose[0]],
            [sc * cb, sc * sb * sa + cc * ca, sc * sb * ca - cc * sa, pose[1]],
            [-sb, cb * sa, cb * ca, pose[2]],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def pose_of(transform: Array) -> Pose6:
    """The pose of a (4, 4) rigid transform, alpha and gamma in -180..180, beta in -90..90.

    At beta = +-90 alpha and gamma turn about one line: all of it is called alpha.
    """
    m = transform.tolist()
    level = math.hypot(m[0][0], m[1][0])
    beta = math.atan2(-m[2][0], level)
    if level > 1e-9:
        alpha, gamma = math.atan2(m[2][1], m[2][2]), math.atan2(m[1][0], m[0][0])
    else:
        alpha, gamma = math.atan2(-m[1][2], m[1][1]), 0.0
    return (m[0][3], m[1][3], m[2][3], math.degrees(alpha), math.degrees(beta), math.degrees(gamma))


def inverse(transform: Array) -> Array:
    """Of a (4, 4) rigid transform."""
    found = np.eye(4)
    found[:3, :3] = transform[:3, :3].T
    found[:3, 3] = -transform[:3, :3].T @ transform[:3, 3]
    return found


def about_z(degrees: float) -> Array:
    """(4, 4) turn about z."""
    return matrix((0.0, 0.0, 0.0, 0.0, 0.0, degrees))


def to_ur(pose: Pose6) -> list[float]:
    """x, y, z m and a rotation vector, rad: the form of a UR controller."""
    turn = Rotation.from_matrix(matrix(pose)[:3, :3]).as_rotvec()
    return [*(0.001 * value for value in pose[:3]), *turn.tolist()]


def from_ur(pose: list[float]) -> Pose6:
    """The pose of what a UR controller says, m and rad."""
    found = np.eye(4)
    found[:3, :3] = Rotation.from_rotvec(pose[3:]).as_matrix()
    found[:3, 3] = 1000.0 * np.asarray(pose[:3])
    return pose_of(found)


def turned_by(one: Pose6, other: Pose6) -> float:
    """Angle between two orientations, deg, from |R1 - R2| = 2 sqrt(2) sin(angle / 2), exact also
    for small angles."""
    if one[3:] == other[3:]:
        return 0.0
    apart = float(np.linalg.norm(matrix(one)[:3, :3] - matrix(other)[:3, :3]))
    return math.degrees(2.0 * math.asin(min(1.0, apart / (2.0 * math.sqrt(2.0)))))


def apart(one: Pose6, other: Pose6) -> float:
    """Distance between two positions, mm."""
    return math.dist(one[:3], other[:3])
