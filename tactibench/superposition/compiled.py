"""The loops of a superposition fit, compiled: fields at places, and least squares of one frame.

They are in a file of their own because numba's cache on disk follows changes of one file only.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

Array = npt.NDArray[np.float64]
Lattice = npt.NDArray[np.float32]

_DAMPING = 1e-4
"""Levenberg-Marquardt damping at the start; it adapts."""
_STUCK = 1e6
"""Damping at which no step helps."""
_LONGEST_MM = 0.8
"""Longest move of a contact in x, y or depth in one step."""
_SMALLEST_STEP_MM = 2e-4
"""The fit of a frame ends when its step is shorter."""
_SMALLEST_NUISANCE = 1e-3
"""The smallest step of a nuisance, in its standard deviations."""


@njit(cache=True, fastmath=True, nogil=True)  # type: ignore[untyped-decorator]
def evaluate(coefficients: Lattice, low: Array, step: Array, places: Array, out: Lattice) -> None:
    """Compute the values of a spline and their slopes along three axes.

    Places outside the knots count as the nearest place inside. Beyond the ends the coefficients
    continue as their mirror image, as in scipy's ``spline_filter``.

    Args:
        coefficients: (X, Y, D, C).
        low: (3,) mm, the first knot of each axis.
        step: (3,) mm between knots.
        places: (M, 3) mm.
        out: (M, 4, C), filled with the values, then the slopes along the axes, 1/mm.
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
        for q in range(out.shape[2]):
            out[m, 0, q] = out[m, 1, q] = out[m, 2, q] = out[m, 3, q] = 0.0
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


@njit(cache=True, nogil=True, error_model="numpy")
def fit_frame(  # type: ignore[no-untyped-def]
    field, motions, moved, weight, whitener, steps, correlated, contacts, nuisances, left, normal
):
    """Move contacts and nuisances of one frame to the least cost; see ``newton.solve``.

    Args:
        field: Coefficients, low, step, ways of variation, and the least and greatest x, y and
            depth, (3,) mm each.
        motions: (R, Q) displacements by each motion of the image.
        moved: (Q,) displacements.
        weight: (M,) 1 / variance.
        whitener: (Q, M) by which residuals are multiplied, or (0, 0) for none: M is then Q.
        steps: Most steps.
        correlated: (N,) how strongly nuisances are held, see ``hold_of``.
        contacts: (K, 3) mm, where the fit starts; filled with the result.
        nuisances: (N,), where the fit starts; filled with the result.
        left: (M,), filled with the residuals.
        normal: (3 K + N, 3 K + N), filled with the normal matrix.
    """
    low, high = field[4], field[5]
    count, others = 3 * len(contacts), len(nuisances)
    for k in range(len(contacts)):
        for axis in range(3):
            contacts[k, axis] = min(max(contacts[k, axis], low[axis]), high[axis])
    size = count + others
    pull, diagonal = np.empty(size), np.empty(size)
    rows = _look(field, motions, moved, whitener, contacts, nuisances)
    _copy(rows[0], left)
    cost, noise = _cost_of(left, weight, nuisances, correlated)
    _fill_normal(rows, weight, nuisances, noise, correlated, normal, pull)
    damping = _DAMPING
    for _ in range(steps if size else 0):
        greatest = 0.0
        for i in range(size):
            diagonal[i] = normal[i, i]
            greatest = max(greatest, diagonal[i])
        matrix = normal.copy()
        for i in range(size):
            # A floor, so that a contact that is too shallow to have an effect does not move.
            matrix[i, i] += damping * (diagonal[i] + 1e-3 * greatest) + 1e-12
        step = np.linalg.solve(matrix, pull)
        longest = 1.0
        for i in range(count):
            longest = max(longest, abs(step[i]) / _LONGEST_MM)
        step /= longest
        tried, other = contacts.copy(), nuisances + step[count:]
        moving = False
        for k in range(len(contacts)):
            for axis in range(3):
                place = contacts[k, axis] + step[3 * k + axis]
                tried[k, axis] = min(max(place, low[axis]), high[axis])
                moving |= abs(tried[k, axis] - contacts[k, axis]) > _SMALLEST_STEP_MM
        for i in range(others):
            moving |= abs(step[count + i]) > _SMALLEST_NUISANCE
        rows = _look(field, motions, moved, whitener, tried, other)
        new_cost, new_noise = _cost_of(rows[0], weight, other, correlated)
        if new_cost <= cost:
            for k in range(len(contacts)):
                _copy(tried[k], contacts[k])
            _copy(other, nuisances)
            _copy(rows[0], left)
            cost = new_cost
            _fill_normal(rows, weight, nuisances, new_noise, correlated, normal, pull)
            damping /= 8
        else:
            damping *= 10
        if not moving or damping >= _STUCK:
            break


@njit(cache=True, nogil=True, error_model="numpy")
def _copy(values, out):  # type: ignore[no-untyped-def]
    """Copy values (N,) to out (N,); numba takes seconds to compile ``out[:] = values``."""
    for i in range(len(out)):
        out[i] = values[i]


@njit(cache=True, nogil=True, error_model="numpy")
def _look(field, motions, moved, whitener, contacts, nuisances):  # type: ignore[no-untyped-def]
    """Return the residuals, and their slopes by contacts and nuisances, (1 + 3 K + N, M).

    The slopes are those of the model, whose values are taken off the displacements.
    """
    coefficients, low, step, ways = field[0], field[1], field[2], field[3]
    width, count = len(moved), len(contacts)
    rows = np.zeros((1 + 3 * count + len(nuisances), width))
    _copy(moved, rows[0])
    parts = np.empty((count, 4, coefficients.shape[3]), np.float32)
    evaluate(coefficients, low, step, contacts, parts)
    for k in range(count):
        for q in range(width):
            value = np.float64(parts[k, 0, q])
            for v in range(ways):
                part = parts[k, 0, (1 + v) * width + q]
                value += nuisances[v] * part
                rows[1 + 3 * count + v, q] += part
            rows[0, q] -= value
        for axis in range(3):
            for q in range(width):
                slope = np.float64(parts[k, 1 + axis, q])
                for v in range(ways):
                    slope += nuisances[v] * parts[k, 1 + axis, (1 + v) * width + q]
                rows[1 + 3 * k + axis, q] = slope
    for r in range(len(motions)):
        _copy(motions[r], rows[1 + 3 * count + ways + r])
        for q in range(width):
            rows[0, q] -= nuisances[ways + r] * motions[r, q]
    return rows @ whitener if len(whitener) else rows


@njit(cache=True, nogil=True, error_model="numpy")
def _cost_of(left, weight, nuisances, correlated):  # type: ignore[no-untyped-def]
    """Return the cost, and the variance of the noise from the misfit (1 without nuisances).

    Without nuisances the misfit itself is the cost: both have their minimum in the same place.
    """
    misfit = (weight * left * left).sum()
    if not len(nuisances):
        return misfit, 1.0
    noise = max(misfit / len(left), 1.0)
    squares = 0.0
    for n in range(len(nuisances)):
        squares += hold_of(noise, correlated[n]) * nuisances[n] ** 2
    return misfit / noise + len(left) * np.log(noise) + squares, noise


@njit(cache=True, nogil=True, error_model="numpy")
def hold_of(noise, correlated):  # type: ignore[no-untyped-def]
    """Return the factor with which a nuisance is held where the noise has a variance.

    Noise beyond that of the camera, which has variance 1, is correlated: so many displacements err
    together.
    """
    return correlated - (correlated - 1.0) / noise


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_normal(rows, weight, nuisances, noise, correlated, normal, pull):  # type: ignore[no-untyped-def]
    """Fill the normal matrix and its right-hand side."""
    size, others = len(pull), len(nuisances)
    slopes = rows[1:]
    weighted = slopes * weight
    products = weighted @ slopes.T
    for i in range(size):
        _copy(products[i], normal[i])
    _copy(weighted @ rows[0], pull)
    for n in range(others):
        i = size - others + n
        hold = noise * hold_of(noise, correlated[n])
        normal[i, i] += hold
        pull[i] -= hold * nuisances[n]
