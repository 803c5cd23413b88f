"""Sub-cell places of peaks by the decoder ``dark``, compiled; see ``peaks`` for its source."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from tactibench_heatmaps.least_squares import RISE, three_points

_FLOOR = 1e-6  # heat below which a logarithm is cut off
_REACH = 5  # half of the 11 x 11 cells of the blur
_BLUR = 2.0  # cells, its Gaussian's sigma
_TAPS = np.exp(-0.5 * (np.arange(-_REACH, _REACH + 1) / _BLUR) ** 2)
_TAPS /= _TAPS.sum()
_SPREAD = (_TAPS * np.arange(-_REACH, _REACH + 1) ** 2).sum()  # cells^2


@njit(cache=True, nogil=True, error_model="numpy")
def expand_maps(maps, stray, slope, base, counts, peaks):  # type: ignore[no-untyped-def]
    """Move the peaks of every map from their cells.

    Args:
        maps: (N, H, W) maps.
        stray: Square of the farthest way by which a peak is moved, cells^2.
        slope: Variance of a peak per heat, cells^2.
        base: Variance of a peak of heat 0, cells^2.
        counts: (N,) numbers of peaks.
        peaks: (N, most, 3) row, column and heat of the peaks, changed in place.
    """
    for n in range(maps.shape[0]):
        for k in range(counts[n]):
            _move_peak(maps[n], peaks[n, k], slope, base, stray)


@njit(cache=True, nogil=True, error_model="numpy")
def _move_peak(one, peak, slope, base, stray):  # type: ignore[no-untyped-def]
    """Move a peak (3,) by the second-order expansion of the logarithm of the blurred map."""
    rows, columns = one.shape
    row, column = int(peak[0]), int(peak[1])
    rim = _REACH + 2
    if not (rim <= row < rows - rim and rim <= column < columns - rim):
        three_points(one, peak)
        return
    logs = np.log(np.maximum(_blurred(one, row, column), _FLOOR))
    dx, dy = 0.5 * (logs[2, 3] - logs[2, 1]), 0.5 * (logs[3, 2] - logs[1, 2])
    dxx = 0.25 * (logs[2, 4] - 2.0 * logs[2, 2] + logs[2, 0])
    dyy = 0.25 * (logs[4, 2] - 2.0 * logs[2, 2] + logs[0, 2])
    dxy = 0.25 * (logs[3, 3] - logs[3, 1] - logs[1, 3] + logs[1, 1])
    det = dxx * dyy - dxy * dxy
    x, y = (dxy * dy - dyy * dx) / det, (dxy * dx - dxx * dy) / det
    rise = 0.5 * (dx * x + dy * y)
    if not (dxx < 0.0 < det and x * x + y * y <= stray and rise <= RISE):
        three_points(one, peak)
        return
    top = math.exp(logs[2, 2] + rise)
    heat = top
    for _ in range(4):  # the blur lowered a peak of variance v by the factor v / (v + spread)
        variance = slope * heat + base
        heat = top * (variance + _SPREAD) / variance
    peak[0] += y
    peak[1] += x
    peak[2] = heat


@njit(cache=True, nogil=True, error_model="numpy")
def _blurred(one, row, column):  # type: ignore[no-untyped-def]
    """Return (5, 5) Gaussian means around a cell that is seven cells or more from the border."""
    out, along = np.zeros((5, 5)), np.zeros(5)
    for r in range(-2 - _REACH, 3 + _REACH):
        along[:] = 0.0
        for b in range(5):
            for c in range(-_REACH, _REACH + 1):
                along[b] += _TAPS[c + _REACH] * one[row + r, column - 2 + b + c]
        for a in range(max(r - _REACH, -2), min(r + _REACH, 2) + 1):
            out[a + 2] += _TAPS[r - a + _REACH] * along
    return out
