"""Sub-cell places of peaks by least squares: the loops over cells, compiled.

They stand in a file of their own because numba's cache on disk follows changes of one file only.
Everything is in cells; the variance of a peak of heat h is ``slope * h + base``. The method and its
source are described in ``peaks``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_STEPS = 2
"""Gauss-Newton steps from the start; ``TOLERANCE`` of ``peaks`` holds after two."""
_MARGIN = math.log(1.15)  # a cell near the seam of two peaks belongs to neither
_HIGHEST = 4.0  # limit of a diverging prediction, so that it cannot overflow
_CEILING = math.log(_HIGHEST)
_STRETCH = math.log(3.0)  # a fit whose sigma^2 is this far from the kernel's is rejected
RISE = math.log(1.6)  # ... and also one this much higher or lower than its cell
_RIDGE = 1e-12  # far below the smallest sum of weights of a peak at the threshold
_DROP = 0.1  # least heat of a cell next to a peak, in units of the peak: below that it is noise


@njit(cache=True, nogil=True, error_model="numpy")
def fit_maps(maps, half, free, stray, slope, base, counts, peaks):  # type: ignore[no-untyped-def]
    """Move the peaks of every map from their cells.

    Args:
        maps: (N, H, W) maps.
        half: Cells of the fit on each side of a peak.
        free: Whether the fit finds the width of a peak.
        stray: Square of the farthest way by which a peak is moved, cells^2.
        slope: Variance of a peak per heat, cells^2.
        base: Variance of a peak of heat 0, cells^2.
        counts: (N,) numbers of peaks.
        peaks: (N, most, 3) row, column and heat of the peaks, changed in place.
    """
    for n in range(maps.shape[0]):
        _fit_peaks(maps[n], peaks[n, : counts[n]], slope, base, half, free, stray)


@njit(cache=True, nogil=True, error_model="numpy")
def _fit_peaks(one, peaks, slope, base, half, free, stray):  # type: ignore[no-untyped-def]
    """Move peaks (K, 3) from their cells to where the paraboloid of log-heat is highest."""
    count = len(peaks)
    theta, fitted = np.empty((count, 4)), np.empty((count, 4))
    rivals, numbers = np.empty((count, count), np.int64), np.zeros(count, np.int64)
    for k in range(count):
        theta[k] = 0.0
        theta[k, 0] = math.log(peaks[k, 2])
        theta[k, 3] = -0.5 / (slope * peaks[k, 2] + base)
    for k in range(count):
        for j in range(count):
            if j != k and _reaches(peaks, theta, j, k, half):
                rivals[k, numbers[k]] = j
                numbers[k] += 1
    for _ in range(_STEPS):
        for k in range(count):
            _gauss_newton_step(
                one, peaks, theta, k, rivals[k, : numbers[k]], half, slope, base, free, fitted[k]
            )
        theta[:] = fitted
    for k in range(count):
        heat = peaks[k, 2]
        sharp = min(theta[k, 3], -1e-9)
        x, y = -0.5 * theta[k, 1] / sharp, -0.5 * theta[k, 2] / sharp
        square = x * x + y * y
        rise = theta[k, 0] - sharp * square
        stretch = math.log(sharp * -2.0 * (slope * heat + base))
        near = square <= stray and abs(stretch) <= _STRETCH  # false for a NaN, too
        if near and abs(rise - math.log(heat)) <= RISE:
            peaks[k, 0] += y
            peaks[k, 1] += x
            peaks[k, 2] = math.exp(rise)
        else:
            three_points(one, peaks[k])


@njit(cache=True, nogil=True, error_model="numpy")
def _reaches(peaks, theta, j, k, half):  # type: ignore[no-untyped-def]
    """Return whether peak j can own a cell of the window of peak k.

    Kernel j gains on kernel k all the way from k to j, so the farthest cell r of the window
    decides: j matters when log h_j - (s - r)^2 / 2 sigma_j^2 comes near to
    log h_k - r^2 / 2 sigma_k^2, with s the distance of the peaks.
    """
    away = math.hypot(peaks[j, 0] - peaks[k, 0], peaks[j, 1] - peaks[k, 1])
    far = math.sqrt(2.0) * half
    gap = max(away - far, 0.0)
    theirs = theta[j, 0] + theta[j, 3] * gap * gap
    return theirs + 2.0 * _MARGIN > theta[k, 0] + theta[k, 3] * far * far


@njit(cache=True, nogil=True, error_model="numpy")
def _gauss_newton_step(one, peaks, theta, k, rivals, half, slope, base, free, out):  # type: ignore[no-untyped-def]
    """Fill out (4,) by one Gauss-Newton step: [1, x, y, x^2 + y^2] around the cell of peak k."""
    rows, columns = one.shape
    row, column = int(peaks[k, 0]), int(peaks[k, 1])
    left, right = max(column - half, 0), min(column + half + 1, columns)
    t0, t1, t2, t3 = theta[k]
    across = np.empty(right - left)  # exp of the part of l that depends on x
    for j in range(left, right):
        x = j - column
        across[j - left] = math.exp(min(x * (t1 + t3 * x), _CEILING))
    m, mx, my, mxx, mxy, myy, mxq, myq, mqq = 9 * (0.0,)  # sums of weight times x, y, q
    r, rx, ry, rq = 4 * (0.0,)
    for i in range(max(row - half, 0), min(row + half + 1, rows)):
        y = i - row
        along = t0 + y * (t2 + t3 * y)
        factor = math.exp(min(along, _CEILING))
        for j in range(left, right):
            x = j - column
            logs = along + x * (t1 + t3 * x)
            owned = True
            for other in rivals:
                away, down = j - peaks[other, 1], i - peaks[other, 0]
                rival = theta[other]
                theirs = rival[0] + away * (rival[1] + rival[3] * away)
                owned &= theirs + down * (rival[2] + rival[3] * down) < logs - _MARGIN
            if not owned:
                continue
            heat = min(factor * across[j - left], _HIGHEST)
            target = heat * (one[i, j] + heat * (logs - 1.0))
            weight, q = heat * heat, x * x + y * y
            wx, wy, wq = weight * x, weight * y, weight * q
            m, mx, my = m + weight, mx + wx, my + wy
            mxx, mxy, myy = mxx + wx * x, mxy + wx * y, myy + wy * y
            mxq, myq, mqq = mxq + wx * q, myq + wy * q, mqq + wq * q
            r, rx, ry, rq = r + target, rx + target * x, ry + target * y, rq + target * q
    normal = np.zeros((4, 4))  # its lower half
    normal[0, 0] = m
    normal[1, 0], normal[1, 1] = mx, mxx
    normal[2, 0], normal[2, 1], normal[2, 2] = my, mxy, myy
    normal[3, 0], normal[3, 1], normal[3, 2], normal[3, 3] = mxx + myy, mxq, myq, mqq
    wanted = np.array([r, rx, ry, rq])
    for a in range(4):
        normal[a, a] += _RIDGE
    fixed = gain = 0.0
    if not free:  # the kernel's curvature at its height, linearised: t3 = fixed + gain t0
        rise = t0 - (t1 * t1 + t2 * t2) / (4.0 * t3)
        heat = math.exp(min(rise, _CEILING))
        held = -0.5 / (slope * heat + base)
        gain = 2.0 * slope * heat * held * held
        fixed = held - gain * t0
        for a in range(3):
            wanted[a] -= normal[3, a] * fixed
        wanted[0] += gain * (wanted[3] - normal[3, 3] * fixed)
        normal[0, 0] += gain * (2.0 * normal[3, 0] + gain * normal[3, 3])
        normal[1, 0] += gain * normal[3, 1]
        normal[2, 0] += gain * normal[3, 2]
    _solve(normal, wanted, 4 if free else 3, out)
    if not free:
        out[3] = fixed + gain * out[0]


@njit(cache=True, nogil=True, error_model="numpy")
def _solve(normal, right, size, out):  # type: ignore[no-untyped-def]
    """Fill out with Cholesky's solution from the lower half of ``normal``; NaN if not definite."""
    for a in range(size):
        for b in range(a + 1):
            value = normal[a, b]
            for c in range(b):
                value -= normal[a, c] * normal[b, c]
            normal[a, b] = math.sqrt(value) if a == b else value / normal[b, b]
        value = right[a]
        for c in range(a):
            value -= normal[a, c] * right[c]
        right[a] = value / normal[a, a]
    for a in range(size - 1, -1, -1):
        value = right[a]
        for c in range(a + 1, size):
            value -= normal[c, a] * out[c]
        out[a] = value / normal[a, a]


@njit(cache=True, nogil=True, error_model="numpy")
def three_points(one, peak):  # type: ignore[no-untyped-def]
    """Move a peak (3,) by the log-parabola through three cells along each axis.

    An axis along which the peak is on the border is left out.
    """
    cell = (int(peak[0]), int(peak[1]))
    centre = rise = math.log(peak[2])
    least = _DROP * peak[2]
    for axis in range(2):
        if not 0 < cell[axis] < one.shape[axis] - 1:
            continue
        down, across = 1 - axis, axis
        low = math.log(max(one[cell[0] - down, cell[1] - across], least))
        high = math.log(max(one[cell[0] + down, cell[1] + across], least))
        bend = 2.0 * centre - low - high
        if bend > 1e-9:  # the centre is a maximum: the shift stays within the cell
            shift = 0.5 * (high - low) / bend
            peak[axis] += shift
            rise += 0.25 * (high - low) * shift
    peak[2] = math.exp(rise)
