"""Discs around contacts, drawn and read: the compiled loops over cells. All lengths are in cells.

They stand in a file of their own because numba's cache on disk follows changes of one file only.
The channels are described in ``discs``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

# Cells by which another peak must be farther away, for a cell to be read: with two peaks that are
# off by half a cell's diagonal each, the difference of their distances is uncertain by 1.41.
_SEAM = 1.5


@njit(cache=True, nogil=True, error_model="numpy")
def draw_discs(place, ends, variance, reach, out):  # type: ignore[no-untyped-def]
    """Draw the heat and the discs of contacts.

    Args:
        place: (M, 3) row, column and depth channel of the contacts.
        ends: (N + 1,), contacts ends[n] to ends[n + 1] are those of map n.
        variance: Variance of the heat, cells^2.
        reach: Radius of the discs.
        out: (N, C, H, W) maps, filled. C is 2, or 4 with offsets.
    """
    _, channels, rows, columns = out.shape
    for n in range(out.shape[0]):
        mine = place[ends[n] : ends[n + 1]]
        for i in range(rows):
            for j in range(columns):
                nearest, square = -1, np.inf
                for k in range(len(mine)):
                    far = (mine[k, 0] - i) ** 2 + (mine[k, 1] - j) ** 2
                    # of two equally near ones the deeper counts, so that their order does not
                    if far < square or (far == square and mine[k, 2] > mine[nearest, 2]):
                        nearest, square = k, far
                within = square <= reach * reach
                out[n, 0, i, j] = math.exp(-0.5 * square / variance) if len(mine) else 0.0
                if channels == 4:
                    out[n, 1, i, j] = _shown(mine[nearest, 1] - j, reach) if within else 0.5
                    out[n, 2, i, j] = _shown(mine[nearest, 0] - i, reach) if within else 0.5
                out[n, channels - 1, i, j] = mine[nearest, 2] if within else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _shown(step, reach):  # type: ignore[no-untyped-def]
    return 0.5 + 0.5 * step / reach


@njit(cache=True, nogil=True, error_model="numpy")
def read_discs(maps, counts, place, inner, reach, value):  # type: ignore[no-untyped-def]
    """Read the depth channel at peaks and, with offsets, move the peaks.

    Both are means over the cells within ``inner`` of a peak that belong to no other peak, weighted
    by heat.

    Args:
        maps: (N, C, H, W) maps.
        counts: (N,) numbers of peaks.
        place: (N, most, 3) row, column and heat of the peaks; with offsets, changed in place.
        inner: Distance from a peak within which cells are read.
        reach: Radius of the discs.
        value: (N, most) depth channel, filled.
    """
    _, channels, rows, columns = maps.shape
    for n in range(maps.shape[0]):
        heat, last = maps[n, 0], maps[n, channels - 1]
        mine = place[n, : counts[n]]
        seen = mine.copy()
        for k in range(len(mine)):
            row, column, total = 0.0, 0.0, 0.0
            top, bottom = math.ceil(seen[k, 0] - inner), math.floor(seen[k, 0] + inner)
            left, right = math.ceil(seen[k, 1] - inner), math.floor(seen[k, 1] + inner)
            depth = 0.0
            for i in range(max(top, 0), min(bottom + 1, rows)):
                for j in range(max(left, 0), min(right + 1, columns)):
                    far = math.hypot(seen[k, 0] - i, seen[k, 1] - j)
                    if far > inner or heat[i, j] <= 0.0 or not _owns(seen, k, i, j, far):
                        continue
                    weight = float(heat[i, j])
                    total += weight
                    depth += weight * last[i, j]
                    if channels == 4:
                        row += weight * (i + 2.0 * reach * (maps[n, 2, i, j] - 0.5))
                        column += weight * (j + 2.0 * reach * (maps[n, 1, i, j] - 0.5))
            # a peak that owns no cell is read at the cell where it lies
            value[n, k] = depth / total if total > 0.0 else last[_cell(seen[k], heat.shape)]
            if channels == 4 and total > 0.0:
                mine[k, 0], mine[k, 1] = row / total, column / total


@njit(cache=True, nogil=True, error_model="numpy")
def _cell(peak, shape):  # type: ignore[no-untyped-def]
    row = min(max(round(peak[0]), 0), shape[0] - 1)
    return row, min(max(round(peak[1]), 0), shape[1] - 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _owns(peaks, k, i, j, far):  # type: ignore[no-untyped-def]
    for other in range(len(peaks)):
        if other != k and math.hypot(peaks[other, 0] - i, peaks[other, 1] - j) < far + _SEAM:
            return False
    return True
