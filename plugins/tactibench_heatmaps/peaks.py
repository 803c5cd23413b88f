"""Peaks of heatmaps by the multidimensional maximum filter.

Source: TactiVerse, "Height Scaling". The filter's window is 3 x 3 cells: a larger one would hide a
shallow contact behind the flank of a deep neighbour. Which peaks are too close is decided between
peaks, by their distance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]
MapStack = npt.NDArray[np.float32]

_WINDOW = np.ones((3, 3), dtype=np.uint8)
_CANDIDATES = 64  # the highest local maxima of a map that are looked at; bounds the work on noise


@dataclass(frozen=True)
class Peaks:
    """Peaks of several maps, in order of map and, within a map, of falling heat.

    frame, row, column: (K,) indices. heat: (K,) value of the cell.
    """

    frame: IntArray
    row: IntArray
    column: IntArray
    heat: FloatArray

    def __len__(self) -> int:
        return len(self.heat)

    def take(self, which: npt.NDArray[np.bool_] | IntArray) -> Peaks:
        return Peaks(self.frame[which], self.row[which], self.column[which], self.heat[which])


def find_peaks(maps: MapStack, threshold: float) -> Peaks:
    """Local maxima of contiguous (N, H, W) maps that reach the threshold; a plateau is one peak.

    A plateau's peak is its cell nearest to its centre. A map without any lower cell has none.
    """
    _, rows, columns = maps.shape
    highest = _dilate(maps)
    np.maximum(highest, np.float32(threshold), out=highest)
    cells = (maps >= highest).ravel().nonzero()[0]
    if len(cells) > 1:
        cells = _without_plateaus(cells, maps)
    heat = maps.ravel()[cells].astype(np.float64)
    frame, cell = np.divmod(cells, rows * columns)
    row, column = np.divmod(cell, columns)
    peaks = Peaks(frame, row, column, heat)
    if len(cells) == 1:
        return peaks if maps.size > 1 else peaks.take(np.zeros(1, dtype=bool))
    peaks = peaks.take(np.lexsort((cells, -heat, frame)))
    return peaks.take(rank(peaks.frame) < _CANDIDATES) if len(cells) > _CANDIDATES else peaks


def rank(frame: IntArray) -> IntArray:
    """(K,) position of every peak among those of its map; ``frame`` is sorted."""
    return np.arange(len(frame)) - np.searchsorted(frame, frame)


def pairs(frame: IntArray) -> tuple[IntArray, IntArray]:
    """All (i, j), i < j, of peaks of the same map, in order of i; ``frame`` is sorted."""
    if len(frame) < 2:
        return _triangle(0)
    if frame[0] == frame[-1]:
        return _triangle(len(frame))
    later = np.searchsorted(frame, frame, side="right") - np.arange(len(frame)) - 1
    first = np.repeat(np.arange(len(frame)), later)
    step = np.arange(len(first)) - np.repeat(np.cumsum(later) - later, later)
    return first, first + 1 + step


def suppress(peaks: Peaks, first: IntArray, second: IntArray) -> Peaks:
    """Without the lower peak of every conflicting pair whose higher peak stays.

    first, second: conflicting pairs as ``pairs`` orders them.
    """
    if not len(first):
        return peaks
    stays = [True] * len(peaks)
    for i, j in zip(first.tolist(), second.tolist(), strict=True):
        if stays[i]:
            stays[j] = False
    return peaks.take(np.array(stays))


@lru_cache(maxsize=_CANDIDATES + 1)
def _triangle(count: int) -> tuple[IntArray, IntArray]:
    first, second = np.triu_indices(count, 1)
    return first, second


def _dilate(maps: MapStack) -> MapStack:
    """The 3 x 3 maximum around every cell; cells beyond the border do not count."""
    highest = np.empty_like(maps)
    for one, out in zip(maps, highest, strict=True):
        cv2.dilate(one, _WINDOW, dst=out)
    return highest


def _without_plateaus(cells: IntArray, maps: MapStack) -> IntArray:
    """Replace touching maxima, which are equal, by one cell of each plateau."""
    _, rows, columns = maps.shape
    if not _any_touch(cells, columns):
        return cells
    frame, cell = np.divmod(cells, rows * columns)
    kept: list[int] = []
    for index in np.unique(frame).tolist():
        mine = cell[frame == index]
        if len(mine) == rows * columns:
            continue
        marked = np.zeros(rows * columns, dtype=np.uint8)
        marked[mine] = 1
        count, labels = cv2.connectedComponents(marked.reshape(rows, columns), connectivity=8)
        label = np.asarray(labels).ravel()[mine]
        start = index * rows * columns
        kept += [start + _central(mine[label == part], columns) for part in range(1, count)]
    return np.array(kept, dtype=np.intp)


def _any_touch(cells: IntArray, columns: int) -> bool:
    """Whether two of the sorted flat indices may be neighbours (a false alarm is harmless)."""
    steps = (1, columns - 1, columns, columns + 1)
    if len(cells) < 9:
        values = cells.tolist()
        have = set(values)
        return any(value + step in have for value in values for step in steps)
    return any(bool(np.isin(cells + step, cells).any()) for step in steps)


def _central(cells: IntArray, columns: int) -> int:
    row, column = np.divmod(cells, columns)
    far = (row - row.mean()) ** 2 + (column - column.mean()) ** 2
    return int(cells[far.argmin()])
