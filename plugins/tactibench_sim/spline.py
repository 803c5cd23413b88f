"""Twice differentiable interpolation of tables in (depth, polar angle), many look-ups at once.

A tensor-product cubic spline in Hermite form. Depth is resolved first, once per contact, which
leaves one short table in the polar angle; the pins of that contact then look up only that.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]


def hermite(fraction: Array, step: float) -> tuple[Array, Array, Array, Array]:
    """Weights of (value, slope) at the left node and (value, slope) at the right node."""
    f, g = fraction, 1 - fraction
    return g * g * (1 + 2 * f), step * f * g * g, f * f * (3 - 2 * f), -step * f * f * g


class PolarTables:
    """Q quantities of M tables on one uniform (depth, polar) grid.

    values: (M, Q, D, T), even in the polar angle, zero at depth 0.
    """

    def __init__(self, delta: Array, polar: Array, values: Sequence[Sequence[Array]]) -> None:
        stack = np.array(values, dtype=np.float64)
        stack[..., 0, :] = 0.0
        slope = CubicSpline(polar, stack, axis=-1, bc_type=("clamped", "not-a-knot"))(polar, 1)
        both = np.stack([stack, slope], axis=-1)  # (M, Q, D, T, 2)
        rate = CubicSpline(delta, both, axis=2)(delta, 1)
        order = (0, 2, 3, 1, 4)  # (M, D, T, Q, 2): what one look-up needs lies together
        shape = (stack.shape[0] * len(delta), -1)
        self._value = np.ascontiguousarray(both.transpose(order)).reshape(shape)
        self._rate = np.ascontiguousarray(rate.transpose(order)).reshape(shape)
        self._rows = len(delta)
        self._depth_step, self._polar_step = float(delta[1]), float(polar[1])
        self._nodes, self._quantities = len(polar), stack.shape[1]

    def at_depth(self, table: Index, depth: Array, scale: Array) -> Array:
        """(C, T, 2 Q) polar tables of C contacts, each times its scale."""
        place = depth / self._depth_step
        left = np.clip(place.astype(np.intp), 0, self._rows - 2)
        weights = hermite(place - left, self._depth_step)
        row = table * self._rows + left
        a, b, c, d = ((scale * weight)[:, None] for weight in weights)
        out = a * self._value[row]
        out += b * self._rate[row]
        out += c * self._value[row + 1]
        out += d * self._rate[row + 1]
        shaped: Array = out.reshape(len(row), self._nodes, 2 * self._quantities)
        return shaped

    def at_polar(self, tables: Array, polar: Array) -> Array:
        """(C, P, Q) of (C, P) polar angles, rad; zero beyond the last node (the clamped rim)."""
        place = polar / self._polar_step
        left = np.minimum(place.astype(np.intp), self._nodes - 2)
        weights = hermite(place - left, self._polar_step)
        a, b, c, d = ((weight * (place <= self._nodes - 1))[..., None] for weight in weights)
        first = left + self._nodes * np.arange(len(tables))[:, None]
        flat = tables.reshape(-1, tables.shape[-1])
        near, far = flat[first], flat[first + 1]
        out: Array = a * near[..., 0::2] + b * near[..., 1::2]
        out += c * far[..., 0::2] + d * far[..., 1::2]
        return out
