"""Poses as six numbers, mm and deg, extrinsic xyz, and as 4 x 4 matrices.

Written apart from what the drivers use, on purpose: an emulator that shared it would share its
mistakes, and agree with them.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Pose6 = tuple[float, float, float, float, float, float]
"""x, y, z mm; alpha, beta, gamma deg about the fixed x, y, z axes, in that order ("sxyz")."""

METRE = 1000.0


def matrix(pose: Pose6) -> Array:
    """(4, 4): R = Rz(gamma) Ry(beta) Rx(alpha), translation mm."""
    a, b, c = (math.radians(angle) for angle in pose[3:])
    ca, sa, cb, sb, cc, sc = (f(x) for x in (a, b, c) for f in (math.cos, math.sin))
    return np.array(
        [
            [cc * cb, cc * sb * sa - sc * ca, cc * sb * ca + sc * sa, pose[0]],
            [sc * cb, sc * sb * sa + cc * ca, sc * sb * ca - cc * sa, pose[1]],
            [-sb, cb * sa, cb * ca, pose[2]],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def pose6(m: Array) -> Pose6:
    """The pose of a matrix; at beta = +-90 deg, where it is not unique, gamma is 0."""
    cb = math.hypot(m[0, 0], m[1, 0])
    beta = math.atan2(-m[2, 0], cb)
    if cb > 1e-9:
        alpha, gamma = math.atan2(m[2, 1], m[2, 2]), math.atan2(m[1, 0], m[0, 0])
    else:
        alpha, gamma = math.atan2(-m[1, 2], m[1, 1]), 0.0
    x, y, z = (float(value) for value in m[:3, 3])
    return x, y, z, math.degrees(alpha), math.degrees(beta), math.degrees(gamma)


def inverse(m: Array) -> Array:
    """Of a rigid transform."""
    out = np.eye(4)
    out[:3, :3] = m[:3, :3].T
    out[:3, 3] = -m[:3, :3].T @ m[:3, 3]
    return out


def from_ur(pose: npt.ArrayLike) -> Array:
    """(4, 4) of metres and a rotation vector (axis times angle, rad): Rodrigues' formula."""
    values = np.asarray(pose, dtype=np.float64)
    out = np.eye(4)
    out[:3, :3] = rotation(values[3:])
    out[:3, 3] = values[:3] * METRE
    return out


def to_ur(m: Array) -> Array:
    """(6,) metres and rotation vector of a matrix in mm."""
    return np.concatenate([m[:3, 3] / METRE, rotation_vector(m[:3, :3])])


def rotation(vector: Array) -> Array:
    """(3, 3) of a rotation vector, rad."""
    return rotations(vector, np.ones(1))[0]


def rotations(vector: Array, shares: Array) -> Array:
    """(N, 3, 3) of shares (N,) of a rotation vector, rad."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.broadcast_to(np.eye(3), (len(shares), 3, 3)).copy()
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned = (angle * shares)[:, None, None]
    out: Array = np.eye(3) + np.sin(turned) * cross + (1 - np.cos(turned)) * (cross @ cross)
    return out


def rotation_vector(r: Array) -> Array:
    """(3,) rad, length 0..pi."""
    sine = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / 2
    length, cosine = float(np.linalg.norm(sine)), (float(np.trace(r)) - 1) / 2
    angle = math.atan2(length, cosine)
    if cosine > -0.999:
        vector: Array = sine * (angle / length) if length > 1e-12 else sine
        return vector
    # Near half a turn the sine is small: the axis is the column of R + 1 that is largest.
    outer = (r + r.T) / 2 - cosine * np.eye(3)
    column = outer[:, int(np.argmax(np.diag(outer)))]
    axis = column / np.linalg.norm(column)
    out: Array = axis * (angle if float(axis @ sine) >= 0 else -angle)
    return out
