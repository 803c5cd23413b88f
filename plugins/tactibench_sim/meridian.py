"""Tables of axisymmetric fields, made ready for look-up: a cubic spline in Hermite form.

Depth is resolved first, once per contact, which leaves one short table in the polar angle; the pins
of that contact then look up only that.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from tactibench_sim.dome_kernels import Array, Meridians


def meridians(depth: Array, polar: Array, values: Sequence[Sequence[Array]]) -> Meridians:
    """values: M times Q tables (D, T), even in the polar angle, zero at depth 0."""
    stack = np.array(values, dtype=np.float64)
    stack[..., 0, :] = 0.0
    slope = CubicSpline(polar, stack, axis=-1, bc_type=("clamped", "not-a-knot"))(polar, 1)
    both = np.stack([stack, slope], axis=-1)  # (M, Q, D, T, 2)
    rate = CubicSpline(depth, both, axis=2)(depth, 1)
    m, q, d, t, _ = both.shape
    order = (0, 2, 3, 1, 4)  # what one look-up needs lies together
    value, rate = (
        np.ascontiguousarray(array.transpose(order)).reshape(m, d, t, 2 * q)
        for array in (both, rate)
    )
    return Meridians(value, rate, float(depth[1]), float(polar[1]))
