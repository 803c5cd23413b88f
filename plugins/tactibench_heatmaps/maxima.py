"""Peaks among the cells of a map: the loops over cells, compiled.

They stand in a file of their own because numba's cache on disk follows changes of one file only.
Everything is in cells; the variance of a peak of heat h is ``slope * h + base``. A peak is
defined in ``peaks``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

CANDIDATES = 64  # highest local maxima of a map that are looked at; bounds the work on noise
_FLANK = 1.1  # factor on the kernel's flanks; a network's flanks are not quite these


@njit(cache=True, nogil=True, error_model="numpy")
def find_peaks(maps, threshold, near, flanks, most, slope, base, counts, peaks):  # type: ignore[no-untyped-def]
    """Find the peaks of every map.

    Args:
        maps: (N, H, W) maps.
        threshold: Least heat of a peak.
        near: Square of the distance below which two peaks are one, cells^2.
        flanks: Whether a bump on the flank of a higher peak is left out.
        most: Most peaks of a map.
        slope: Variance of a peak per heat, cells^2.
        base: Variance of a peak of heat 0, cells^2.
        counts: (N,) numbers of peaks, filled.
        peaks: (N, most, 3) row, column and heat of the peaks, filled.
    """
    cells = np.empty(maps.shape[1] * maps.shape[2], np.int64)
    highest = np.empty(CANDIDATES, np.int64)
    heat = np.empty(CANDIDATES, np.float64)
    bump = 0.5 * threshold if flanks else -1.0
    for n in range(maps.shape[0]):
        heatmap = maps[n]
        count = _rank(heatmap, cells, _maxima(heatmap, threshold, cells), highest, heat)
        count = _separate(heatmap.shape[1], count, highest, heat, near, bump, slope, base, most)
        counts[n] = count
        for k in range(count):
            peaks[n, k, 0], peaks[n, k, 1] = divmod(highest[k], heatmap.shape[1])
            peaks[n, k, 2] = heat[k]


@njit(cache=True, nogil=True, error_model="numpy")
def _maxima(one, threshold, cells):  # type: ignore[no-untyped-def]
    """Fill cells with the flat indices of the local maxima of a map; return how many there are."""
    rows, columns = one.shape
    least = np.float32(threshold)
    column = np.empty(columns, np.float32)
    count, tie = 0, False
    for i in range(rows):
        above, below = one[max(i - 1, 0)], one[min(i + 1, rows - 1)]
        middle = one[i]
        for j in range(columns):  # the highest of three rows; this loop runs in vectors
            column[j] = max(max(above[j], below[j]), middle[j])
        for j in range(columns):
            value = middle[j]
            if value < least or value < column[j]:
                continue
            left, right = max(j - 1, 0), min(j + 1, columns - 1)
            if value < column[left] or value < column[right]:
                continue
            cells[count] = i * columns + j
            count += 1
            level = 0  # equally high cells of the 3 x 3, itself included
            for r in range(max(i - 1, 0), min(i + 2, rows)):
                for c in range(left, right + 1):
                    level += one[r, c] == value
            tie |= level > 1
    return _without_plateaus(one, cells, count) if tie else min(count, one.size - 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _without_plateaus(one, cells, count):  # type: ignore[no-untyped-def]
    """Keep one of touching maxima, which are equal: the one nearest to their centre."""
    rows, columns = one.shape
    if count == rows * columns:
        return 0
    waiting = np.zeros(rows * columns, np.bool_)
    for k in range(count):
        waiting[cells[k]] = True
    members = np.empty(count, np.int64)
    kept = 0
    for k in range(count):
        if not waiting[cells[k]]:
            continue
        members[0], last = cells[k], 1
        waiting[cells[k]] = False
        m = 0
        while m < last:
            i, j = divmod(members[m], columns)
            m += 1
            for r in range(max(i - 1, 0), min(i + 2, rows)):
                for c in range(max(j - 1, 0), min(j + 2, columns)):
                    if waiting[r * columns + c]:
                        waiting[r * columns + c] = False
                        members[last] = r * columns + c
                        last += 1
        cells[kept] = _central(members[:last], columns)  # kept <= k: none is lost
        kept += 1
    return kept


@njit(cache=True, nogil=True, error_model="numpy")
def _central(members, columns):  # type: ignore[no-untyped-def]
    row = column = 0.0
    for cell in members:
        row += cell // columns
        column += cell % columns
    row, column = row / len(members), column / len(members)
    best, nearest = members[0], np.inf
    for cell in members:
        far = (cell // columns - row) ** 2 + (cell % columns - column) ** 2
        if far < nearest or (far == nearest and cell < best):
            best, nearest = cell, far
    return best


@njit(cache=True, nogil=True, error_model="numpy")
def _rank(one, cells, count, highest, heat):  # type: ignore[no-untyped-def]
    """Sort the highest cells by falling heat, equal ones by place; return how many there are."""
    values = one.ravel()
    kept = 0
    for k in range(count):
        value = np.float64(values[cells[k]])
        at = kept if kept < CANDIDATES else CANDIDATES - 1
        if kept == CANDIDATES and value <= heat[at]:
            continue
        while at > 0 and value > heat[at - 1]:
            heat[at], highest[at] = heat[at - 1], highest[at - 1]
            at -= 1
        heat[at], highest[at] = value, cells[k]
        kept = min(kept + 1, CANDIDATES)
    return kept


@njit(cache=True, nogil=True, error_model="numpy")
def _separate(columns, count, highest, heat, near, bump, slope, base, most):  # type: ignore[no-untyped-def]
    """Drop the lower of two peaks that count as one, unless the higher was dropped.

    Returns:
        The number of peaks that are left, at most ``most``.
    """
    kept = 0
    for k in range(count):
        stays = True
        for j in range(kept):
            row = highest[j] // columns - highest[k] // columns
            column = highest[j] % columns - highest[k] % columns
            square = row * row + column * column
            if square < near:
                stays = False
            elif bump >= 0.0:
                flank = heat[j] * math.exp(-0.5 * square / (slope * heat[j] + base))
                stays &= heat[k] >= _FLANK * flank + bump
        if stays:
            highest[kept], heat[kept] = highest[k], heat[k]
            kept += 1
            if kept == most:
                break
    return kept
