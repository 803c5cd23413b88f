"""The encoder ``hertz``: the depth-weighted Hertz-Gaussian heatmap and its two decoders."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from tactibench import Contacts, Grid, UserError
from tactibench_heatmaps.kernel import Kernel
from tactibench_heatmaps.peaks import (
    FloatArray,
    MapStack,
    Peaks,
    find_peaks,
    pairs,
    rank,
    suppress,
)
from tactibench_heatmaps.subcell import fit_peaks

_FLANK = 1.1  # a network's flanks are not quite the kernel's
_CHUNK = 64  # maps decoded at a time, so that a chunk stays in the cache


class HertzGaussian:
    """Contacts <-> one map of Gaussians: height d / max_depth, sigma^2 = R d / 9 + blur^2.

    Parameters as declared in ``hooks``. Kernels combine by maximum and are never rounded to a cell.

    decoder "maximum": cell centre and heat of each peak of the maximum filter, as published.
    decoder "least-squares": the same peaks fitted between the cells. There a peak must also rise
    above the flanks that the kernel predicts for the higher peaks of its map, by a tenth of them
    and half the ``threshold``, so that a bump on a flank is no contact.

    The score of a contact is the heat of its peak, cut to 0..1: the deepest comes first.

    separation and tolerance, mm, hold for the default parameters on a 64 x 64 grid of 0.4 mm pitch
    and depths of 0.5 to 6 mm in any combination.
    """

    channels = 1
    separation = 6.5

    def __init__(
        self,
        *,
        max_depth: float = 6.0,
        radius: float = 3.0,
        blur: float = 2.0,
        decoder: str = "least-squares",
        threshold: float = 0.25 / 6.0,
        min_distance: float = 3.0,
        max_count: int = 6,
        window: int = 11,
        width: str = "free",
    ) -> None:
        self.kernel = Kernel(max_depth, radius, blur)
        self.decoder = decoder
        self.threshold = threshold
        self.min_distance = min_distance
        self.max_count = max_count
        self.window = window
        self.width = width
        # half a cell for a maximum at a cell centre; float32 and two Gauss-Newton steps for a fit
        self.tolerance = 0.201 if decoder == "maximum" else 0.002

    def encode(self, contacts: Contacts, grid: Grid) -> npt.NDArray[np.float32]:
        """Return the (1, H, W) float32 map. Raises UserError for a depth outside 0..max_depth."""
        return self.kernel.render([contacts], grid)

    def encode_batch(self, contacts: Sequence[Contacts], grid: Grid) -> npt.NDArray[np.float32]:
        """Return (N, 1, H, W) float32 maps, the same as ``encode`` one by one."""
        return self.kernel.render(contacts, grid)[:, None]

    def decode(self, maps: npt.ArrayLike, grid: Grid) -> Contacts:
        """Read contacts from one (1, H, W) map, best first.

        Raises ValueError for another shape, UserError for values that are not finite.
        """
        return self._decode(_checked(maps, (self.channels, *grid.shape)), grid)[0]

    def decode_batch(self, maps: npt.ArrayLike, grid: Grid) -> list[Contacts]:
        """Read contacts from (N, 1, H, W) maps, the same as ``decode`` one by one."""
        stack = _checked(maps, (None, self.channels, *grid.shape))
        found: list[Contacts] = []
        for start in range(0, len(stack), _CHUNK):
            found += self._decode(stack[start : start + _CHUNK], grid)
        return found

    def _decode(self, stack: MapStack, grid: Grid) -> list[Contacts]:
        peaks = self._peaks(stack, grid)
        if not len(peaks):
            return [Contacts.none()] * len(stack)
        xy = grid.xy(peaks.row, peaks.column)
        heat = peaks.heat
        if self.decoder == "least-squares":
            free = self.width == "free"
            offset, heat = fit_peaks(stack, peaks, self.kernel, grid.pitch, self.window, free)
            xy += offset
        depth = heat * self.kernel.max_depth
        score = np.minimum(heat, 1.0)
        if len(stack) == 1:
            return [Contacts(xy, depth, score)]
        ends = np.searchsorted(peaks.frame, np.arange(len(stack) + 1)).tolist()
        return [
            Contacts(xy[a:b], depth[a:b], score[a:b]) if b > a else Contacts.none()
            for a, b in pairwise(ends)
        ]

    def _peaks(self, stack: MapStack, grid: Grid) -> Peaks:
        peaks = find_peaks(stack, self.threshold)
        if len(peaks) < 2:
            return peaks
        high, low = pairs(peaks.frame)
        if len(high):
            conflict = self._conflicts(peaks, high, low, grid)
            peaks = suppress(peaks, high[conflict], low[conflict])
        if len(peaks) > self.max_count:
            peaks = peaks.take(rank(peaks.frame) < self.max_count)
        return peaks

    def _conflicts(
        self,
        peaks: Peaks,
        high: npt.NDArray[np.intp],
        low: npt.NDArray[np.intp],
        grid: Grid,
    ) -> npt.NDArray[np.bool_]:
        """Which pairs are one contact: too close or, for the fit, the lower one a bump."""
        rows, columns = peaks.row[high] - peaks.row[low], peaks.column[high] - peaks.column[low]
        square = grid.pitch**2 * (rows * rows + columns * columns)
        close: npt.NDArray[np.bool_] = square < self.min_distance**2
        if self.decoder == "least-squares":
            above: FloatArray = peaks.heat[high]
            flank = above * np.exp(-0.5 * square / self.kernel.variance(above))
            close |= peaks.heat[low] < _FLANK * flank + 0.5 * self.threshold
        return close


def _checked(maps: npt.ArrayLike, shape: tuple[int | None, ...]) -> MapStack:
    """Contiguous (N, H, W) float32 of maps with the given shape; the input is left as it is."""
    given = np.asarray(maps)
    fits = given.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(given.shape, shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("N" if size is None else str(size) for size in shape)
        raise ValueError(f"maps have shape {given.shape}, expected ({wanted})")
    stack = np.ascontiguousarray(given, dtype=np.float32).reshape(-1, *shape[-2:])
    if not np.isfinite(stack.sum()) and not np.isfinite(stack).all():
        bad = int((~np.isfinite(stack)).sum())
        raise UserError(
            f"the heatmaps hold {bad} of {stack.size} values that are not finite; the model that "
            "drew them has diverged: train it again, with a lower learning rate."
        )
    return stack
