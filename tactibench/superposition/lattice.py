"""Values and slopes of a cubic B-spline on a lattice, compiled: 64 products each."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

Array = npt.NDArray[np.float64]
Lattice = npt.NDArray[np.float32]


@njit(cache=True, fastmath=True, nogil=True)  # type: ignore[untyped-decorator]
def evaluate(coefficients: Lattice, low: Array, step: Array, places: Array, out: Lattice) -> None:
    """Fill out (M, 4, Q): the value and its slopes along three axes, at places (M, 3).

    coefficients: (X, Y, D, Q). Places outside the knots count as the nearest one inside; beyond the
    ends the coefficients go on as their mirror image, as scipy's ``spline_filter`` has it.
    """
    weight, slope = np.empty((3, 4)), np.empty((3, 4))
    index = np.empty((3, 4), np.int64)
    for m in range(len(places)):
        for axis in range(3):
            last = coefficients.shape[axis] - 1
            place = min(max((places[m, axis] - low[axis]) / step[axis], 0.0), float(last))
            cell = min(int(place), last - 1)
            t = place - cell
            s = 1 - t
            weight[axis, 0] = s**3 / 6
            weight[axis, 1] = (4 - 3 * t * t * (1 + s)) / 6
            weight[axis, 2] = (4 - 3 * s * s * (1 + t)) / 6
            weight[axis, 3] = t**3 / 6
            half = 0.5 / step[axis]
            slope[axis, 0] = -s * s * half
            slope[axis, 1] = t * (3 * t - 4) * half
            slope[axis, 2] = s * (4 - 3 * s) * half
            slope[axis, 3] = t * t * half
            for k in range(4):
                knot = abs(cell - 1 + k)
                index[axis, k] = knot if knot <= last else 2 * last - knot
        out[m] = 0
        for i in range(4):
            for j in range(4):
                for k in range(4):
                    value = np.float32(weight[0, i] * weight[1, j] * weight[2, k])
                    along_x = np.float32(slope[0, i] * weight[1, j] * weight[2, k])
                    along_y = np.float32(weight[0, i] * slope[1, j] * weight[2, k])
                    along_d = np.float32(weight[0, i] * weight[1, j] * slope[2, k])
                    row = coefficients[index[0, i], index[1, j], index[2, k]]
                    for q in range(len(row)):
                        out[m, 0, q] += value * row[q]
                        out[m, 1, q] += along_x * row[q]
                        out[m, 2, q] += along_y * row[q]
                        out[m, 3, q] += along_d * row[q]
