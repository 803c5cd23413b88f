"""Poses as (x, y, z, alpha, beta, gamma), mm and deg, extrinsic sxyz, and as 4 x 4 matrices."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from tactibench_tactip.settings import EnvelopeSettings, Pose6

Array = npt.NDArray[np.float64]

ROUNDING_MM, ROUNDING_DEG = 1e-6, 1e-3
"""Distance and angle by which rounding may take a pose of a plan out of the envelope."""


def matrix(pose: Pose6) -> Array:
    """Return the (4, 4) transform of a pose: R = Rz(gamma) Ry(beta) Rx(alpha)."""
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
    """Return the angle between two orientations, deg.

    From |R1 - R2| = 2 sqrt(2) sin(angle / 2), which is exact also for small angles.
    """
    if a[3:] == b[3:]:
        return 0.0
    difference = float(np.linalg.norm(matrix(a)[:3, :3] - matrix(b)[:3, :3]))
    return math.degrees(2.0 * math.asin(min(1.0, difference / (2.0 * math.sqrt(2.0)))))


def distance_between(a: Pose6, b: Pose6) -> float:
    """Return the distance between two positions, mm."""
    return math.dist(a[:3], b[:3])


def envelope_violation(limits: EnvelopeSettings, pose: Pose6) -> str:
    """Return a clause about how a pose in the work frame leaves the envelope, "" inside it.

    Comparisons are written so that NaN fails them. A software limit is no safety function: it
    catches mistakes of a configuration, not of a controller.
    """
    x, y, z, _, _, gamma = pose
    for name, value in (("x", x), ("y", y)):
        if not abs(value) <= limits.half_width_mm + ROUNDING_MM:
            return (
                f"{name} {value:.2f} mm of the work frame, where envelope.half_width_mm allows "
                f"{limits.half_width_mm:g} mm"
            )
    if not -limits.above_mm - ROUNDING_MM <= z:
        return f"z {z:.2f} mm, where envelope.above_mm allows {-limits.above_mm:g} mm"
    if not z <= limits.below_mm + ROUNDING_MM:
        return f"z {z:.2f} mm, where envelope.below_mm allows {limits.below_mm:g} mm"
    # max first: it turns a NaN into -1, a tilt of 180 deg; min first would turn it into no tilt.
    tilt = math.degrees(math.acos(min(1.0, max(-1.0, float(matrix(pose)[2, 2])))))
    if not tilt <= limits.tilt_deg + ROUNDING_DEG:
        return f"a tilt of {tilt:.1f} deg, where envelope.tilt_deg allows {limits.tilt_deg:g} deg"
    if not abs(gamma) <= limits.yaw_deg + ROUNDING_DEG:
        return f"a yaw of {gamma:.1f} deg, where envelope.yaw_deg allows {limits.yaw_deg:g} deg"
    return ""
