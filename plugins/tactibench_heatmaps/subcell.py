"""Least-squares fit of peaks between the cells.

Around each peak, log-heat is the paraboloid l(u) = t . [1, u_x, u_y, |u|^2]. Heat h is taken to
carry noise of equal size in every cell, so log-heat is weighted by m^2, with m = exp(l) the heat
that the current estimate predicts; for the same reason the logarithm, which noise near zero would
ruin, is replaced by its tangent at m: log h ~ l + (h - m) / m. This is Gauss-Newton on heat, and
two steps from the kernel at the peak's cell suffice. Cells where another peak predicts more heat
belong to that one and are left out, so that neighbours do not pull at each other.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from tactibench_heatmaps.kernel import Kernel
from tactibench_heatmaps.peaks import FloatArray, IntArray, MapStack, Peaks, pairs

_STEPS = 2
_MARGIN = np.log(1.15)  # a cell near the seam of two peaks belongs to neither
_CEILING = np.log(4.0)  # of a diverging prediction, so that it cannot overflow
_STRAY_MM = 1.2  # noise moves the highest cell this far at most; a fit beyond it is none
_STRETCH = np.log(3.0)  # ... nor one whose sigma^2 is this far from the kernel's
_RISE = np.log(1.6)  # ... nor one this much higher or lower than its cell
_RIDGE = 1e-12  # far below the smallest sum of weights of a peak at the threshold


def fit_peaks(
    maps: MapStack, peaks: Peaks, kernel: Kernel, pitch: float, window: int, free: bool
) -> tuple[FloatArray, FloatArray]:
    """Offsets (K, 2) from the peaks' cells in mm (x, y), and heats (K,) of the fitted peaks.

    maps: contiguous (N, H, W). window: side in cells, odd. free: whether the width is fitted, or
    the kernel's at the fitted heat. A fit that is not concave, strays, or is far from the kernel
    gives way to a parabola through three cells an axis, and that to the cell itself.
    """
    design, products, across = _design(window, pitch)
    heat, inside = _windows(maps, peaks, window)
    rivals = _Rivals.within(design, peaks, kernel, pitch)
    start = -0.5 / kernel.variance(peaks.heat)
    theta = np.zeros((len(peaks), 4))
    theta[:, 0] = logs_at = np.log(peaks.heat)
    theta[:, 3] = start
    for _ in range(_STEPS):
        logs = theta @ across
        weight = np.exp(np.minimum(logs, _CEILING))
        if inside is not None:
            weight *= inside
        if rivals is not None:
            weight *= rivals.strongest(theta, across) < logs - _MARGIN
        target = weight * (heat + weight * (logs - 1.0))
        weight *= weight
        curve = None if free else _curvature(theta, kernel)
        theta = _solve(weight @ products, target @ design, curve)
    sharp = np.minimum(theta[:, 3], -1e-9)
    offset = theta[:, 1:3] / (-2.0 * sharp[:, None])
    square = (offset * offset).sum(axis=1)
    rise = theta[:, 0] - sharp * square
    good = (
        (square <= _STRAY_MM**2)
        & (np.abs(rise - logs_at) <= _RISE)
        & (np.abs(np.log(sharp / start)) <= _STRETCH)
    )
    if not good.all():
        offset[~good], rise[~good] = _three_point(maps, peaks.take(~good), pitch)
    return offset, np.exp(rise)


@lru_cache(maxsize=8)
def _design(window: int, pitch: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(M, 4) rows [1, u_x, u_y, |u|^2], their (M, 16) outer products, and the rows' transpose."""
    half = window // 2
    y, x = np.meshgrid(*2 * [pitch * np.arange(-half, half + 1)], indexing="ij")
    design = np.column_stack([np.ones(x.size), x.ravel(), y.ravel(), (x * x + y * y).ravel()])
    products = (design[:, :, None] * design[:, None, :]).reshape(-1, 16)
    return design, products, np.ascontiguousarray(design.T)


@lru_cache(maxsize=8)
def _steps(window: int, columns: int) -> tuple[IntArray, IntArray]:
    """(w,) steps from the centre, and (w * w,) the same as steps of a flat index."""
    step = np.arange(window) - window // 2
    return step, (step[:, None] * columns + step).ravel()


def _windows(
    maps: MapStack, peaks: Peaks, window: int
) -> tuple[FloatArray, npt.NDArray[np.bool_] | None]:
    """(K, M) heat around the peaks, and which cells lie in the map; None: all do."""
    _, rows, columns = maps.shape
    step, flat = _steps(window, columns)
    half = window // 2
    row, column = peaks.row, peaks.column
    corner = (peaks.frame * rows + row) * columns + column
    if (
        row.min() >= half
        and row.max() < rows - half
        and column.min() >= half
        and column.max() < columns - half
    ):
        return maps.ravel()[corner[:, None] + flat].astype(np.float64), None
    high, wide = row[:, None] + step, column[:, None] + step
    inside = ((high >= 0) & (high < rows))[:, :, None] & ((wide >= 0) & (wide < columns))[:, None]
    inside = inside.reshape(len(peaks), -1)
    flat = np.where(inside, corner[:, None] + flat, corner[:, None])
    return maps.ravel()[flat].astype(np.float64), inside


class _Rivals:
    """What the other peaks of a map predict in the window of a peak.

    owner: (K',) the peaks that have rivals. starts: (K',) where each one's begin in rival (P,), the
    rivals' indices, and away (P, 2), their distance in mm.
    """

    def __init__(self, owner: IntArray, rival: IntArray, away: FloatArray) -> None:
        order = owner.argsort(kind="stable")
        owner = owner[order]
        self.rival = rival[order]
        self.away = away[order]
        self.starts = np.concatenate([[0], np.flatnonzero(owner[1:] != owner[:-1]) + 1])
        self.owner = owner[self.starts]

    @classmethod
    def within(
        cls, design: FloatArray, peaks: Peaks, kernel: Kernel, pitch: float
    ) -> _Rivals | None:
        """The rivals that can own a cell of a peak's window; None when there are none.

        Kernel j gains on kernel i all the way from i to j, so the farthest cell r of the window
        decides: j matters when log h_j - (s - r)^2 / 2 sigma_j^2 comes near to
        log h_i - r^2 / 2 sigma_i^2, with s the distance of the peaks.
        """
        first, second = pairs(peaks.frame)
        if not len(first):
            return None
        owner, rival = np.concatenate([first, second]), np.concatenate([second, first])
        place = pitch * np.stack([peaks.column, peaks.row], axis=1)
        away = place[rival] - place[owner]
        far_square = design[-1, 3]
        curve, logs = 0.5 / kernel.variance(peaks.heat), np.log(peaks.heat)
        gap = np.maximum(np.sqrt((away * away).sum(axis=1)) - np.sqrt(far_square), 0.0)
        theirs = (logs[rival] - curve[rival] * gap * gap) + 2.0 * _MARGIN
        near = theirs > (logs - curve * far_square)[owner]
        return cls(owner[near], rival[near], away[near]) if near.any() else None

    def strongest(self, theta: FloatArray, across: FloatArray) -> FloatArray:
        """(K, M) greatest log-heat that another peak predicts; minus infinity without one."""
        one, away = theta[self.rival], self.away
        curve = one[:, 3:]
        slope = one[:, 1:3] - 2.0 * curve * away
        moved = np.concatenate([one[:, :1], slope, curve], axis=1)
        moved[:, 0] -= ((one[:, 1:3] - curve * away) * away).sum(axis=1)
        found = np.maximum.reduceat(moved @ across, self.starts, axis=0)
        strongest = np.full((len(theta), across.shape[1]), -np.inf)
        strongest[self.owner] = found
        return strongest


def _curvature(theta: FloatArray, kernel: Kernel) -> FloatArray:
    """-1 / (2 sigma^2) of the kernel at the heat of the estimate."""
    slope, curve = theta[:, 1:3], theta[:, 3]
    rise = theta[:, 0] - (slope * slope).sum(axis=1) / (4.0 * curve)
    found: FloatArray = -0.5 / kernel.variance(np.exp(np.minimum(rise, _CEILING)))
    return found


def _solve(normal: FloatArray, right: FloatArray, curve: FloatArray | None) -> FloatArray:
    """(K, 4) solutions of (K, 16) normal matrices; a given ``curve`` is held, the rest solved for.

    A window with too few cells of its own has no solution; the ridge makes it harmless.
    """
    normal[:, ::5] += _RIDGE
    square = normal.reshape(-1, 4, 4)
    if curve is None:
        return np.asarray(np.linalg.solve(square, right[:, :, None])[:, :, 0], dtype=np.float64)
    held = right[:, :3] - square[:, :3, 3] * curve[:, None]
    free = np.linalg.solve(square[:, :3, :3], held[:, :, None])[:, :, 0]
    return np.column_stack([free, curve])


def _three_point(maps: MapStack, peaks: Peaks, pitch: float) -> tuple[FloatArray, FloatArray]:
    """Offsets (K, 2) mm and log-heats (K,) by the log-parabola through three cells an axis."""
    offset = np.zeros((len(peaks), 2))
    centre = np.log(peaks.heat)
    rise = centre.copy()
    for axis, (index, size) in enumerate(
        ((peaks.column, maps.shape[2]), (peaks.row, maps.shape[1]))
    ):
        inner = np.flatnonzero((index > 0) & (index < size - 1))
        at = [peaks.frame[inner], peaks.row[inner], peaks.column[inner]]
        sides = []
        for step in (-1, 1):
            moved = list(at)
            moved[2 - axis] = moved[2 - axis] + step
            sides.append(np.log(np.maximum(maps[tuple(moved)].astype(np.float64), 1e-6)))
        low, high = sides
        bend = 2.0 * centre[inner] - low - high
        # the centre is a maximum, so |high - low| <= bend and the shift stays within the cell
        shift = np.where(bend > 1e-9, (high - low) / np.maximum(2.0 * bend, 1e-9), 0.0)
        offset[inner, axis] = pitch * shift
        rise[inner] += 0.25 * (high - low) * shift
    return offset, rise
