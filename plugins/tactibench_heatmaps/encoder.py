"""The base of the encoders: maps of whole batches, checked before they are read."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from tactibench import Contacts, Encoder, Grid, UserError
from tactibench_heatmaps.least_squares import fit_maps
from tactibench_heatmaps.maxima import find_peaks

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

WIDE = 17
"""Cells a side that the decoder `wide` fits: 4 sigma of the default heat to either side."""
# round-trip error, mm on cells of 0.4 mm: half a cell; two steps
TOLERANCE = {"maximum": 0.201, "least-squares": 0.002, "wide": 0.002}
_STRAY = 0.6  # in sigmas of the narrowest kernel: noise moves the highest cell this far at most


@dataclass(frozen=True)
class Peaks:
    """Peaks of N maps.

    Attributes:
        counts: (N,) numbers of peaks.
        place: (N, most, 3) row, column, heat, best first; the rows behind a map's count have no
            meaning.
    """

    counts: IntArray
    place: FloatArray

    def flat(self, values: FloatArray) -> FloatArray:
        """Return (K, ...) values of all K peaks, map by map, from (N, most, ...) values."""
        if len(self.counts) == 1:
            return values[0, : self.counts[0]]
        return values[np.arange(values.shape[1]) < self.counts[:, None]]


@dataclass(frozen=True)
class PeakReader:
    """The way in which peaks are read.

    Attributes:
        slope: Kernels have sigma^2 = slope * heat + base, mm^2.
        base: See slope.
        decoder: "maximum", "least-squares" or "wide".
        threshold: Least heat of a peak.
        min_distance: Least distance between peaks, mm.
        max_count: Most peaks of a map.
        window: Cells a side of the fit of "least-squares", odd.
        free: Whether the fit finds the width of a peak, or holds it at the kernel's.
        flanks: Whether a peak must also rise above the flanks that the kernel predicts for the
            higher peaks of its map, by a tenth of them and half the threshold.
    """

    slope: float
    base: float
    decoder: str
    threshold: float
    min_distance: float
    max_count: int
    window: int = 11
    free: bool = True
    flanks: bool = True

    def read(self, stack: MapStack, pitch: float) -> Peaks:
        """Return the peaks of (N, H, W) maps with cells of this pitch, mm."""
        counts = np.empty(len(stack), dtype=np.int64)
        place = np.empty((len(stack), self.max_count, 3))
        maps = np.ascontiguousarray(stack)
        slope, base = self.slope / (pitch * pitch), self.base / (pitch * pitch)
        near = self.min_distance**2 / (pitch * pitch)
        find_peaks(
            maps, self.threshold, near, self.flanks, self.max_count, slope, base, counts, place
        )
        stray = max(_STRAY**2 * base, 1.0)
        if self.decoder != "maximum":
            half = (WIDE if self.decoder == "wide" else self.window) // 2
            fit_maps(maps, half, self.free, stray, slope, base, counts, place)
        return Peaks(counts, place)


def split_contacts(
    counts: IntArray, xy: FloatArray, depth: FloatArray, score: FloatArray
) -> list[Contacts]:
    """Return the contacts of every map.

    Args:
        counts: (N,) numbers of contacts of the maps.
        xy: (K, 2) places of the contacts of all maps, map by map, mm.
        depth: (K,) depths, mm.
        score: (K,) scores.
    """
    if len(counts) == 1:
        return [Contacts(xy, depth, score)]
    ends = [0, *np.cumsum(counts).tolist()]
    return [
        Contacts(xy[a:b], depth[a:b], score[a:b]) if b > a else Contacts.none()
        for a, b in pairwise(ends)
    ]


MapStack = npt.NDArray[np.float32]
LARGEST = 1e6
"""Largest heat that is read. Heat is about 1 at most; a million times that can overflow."""


class MapEncoder(Encoder):
    """Contacts <-> C = ``channels`` maps on the H x W cells of a grid.

    Attributes:
        separation: Contacts farther apart than this are told apart, mm.
        tolerance: Largest error of a round trip, mm.
    """

    def encode(self, contacts: Contacts, grid: Grid) -> MapStack:
        """Return (C, H, W) float32 maps.

        Raises:
            UserError: The maps cannot show the contacts.
        """
        maps: MapStack = self.encode_batch([contacts], grid)[0]
        return maps

    @abstractmethod
    def encode_batch(self, contacts: Sequence[Contacts], grid: Grid) -> MapStack:
        """Return (N, C, H, W) float32 maps, the same as ``encode`` one by one."""

    def decode(self, maps: npt.ArrayLike, grid: Grid) -> Contacts:
        """Read contacts from (C, H, W) maps, best first.

        Raises:
            ValueError: The maps have another shape.
            UserError: A value is not finite or beyond ``LARGEST``.
        """
        return self._decode(_checked(maps, (self.channels, *grid.shape)), grid)[0]

    def decode_batch(self, maps: npt.ArrayLike, grid: Grid) -> list[Contacts]:
        """Read contacts from (N, C, H, W) maps, the same as ``decode`` one by one.

        Raises:
            ValueError: The maps have another shape.
            UserError: A value is not finite or beyond ``LARGEST``.
        """
        return self._decode(_checked(maps, (None, self.channels, *grid.shape)), grid)

    @abstractmethod
    def _decode(self, stack: MapStack, grid: Grid) -> list[Contacts]:
        """Return the contacts of each of (N, C, H, W) maps, best first.

        The maps are finite, contiguous and writeable.
        """


def _checked(maps: npt.ArrayLike, shape: tuple[int | None, ...]) -> MapStack:
    """Return contiguous (N, C, H, W) float32 maps; the input is left as it is.

    Args:
        maps: One map or several.
        shape: The shape that they must have; None: any size.

    Raises:
        ValueError: The maps have another shape.
        UserError: A value is not finite or beyond ``LARGEST``.
    """
    given = np.asarray(maps)
    fits = given.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(given.shape, shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("N" if size is None else str(size) for size in shape)
        raise ValueError(f"maps have shape {given.shape}, expected ({wanted})")
    stack = np.ascontiguousarray(given, dtype=np.float32).reshape(-1, *given.shape[-3:])
    # the extremes of a map with NaN are NaN
    if stack.size and not (stack.max() <= LARGEST and stack.min() >= -LARGEST):
        bad = int((~(np.abs(stack) <= LARGEST)).sum())
        raise UserError(
            f"the heatmaps hold {bad} of {stack.size} values that are not finite or beyond "
            f"{LARGEST:g}; the model that drew them has diverged: train it again, with a lower "
            "learning rate."
        )
    # for read-only arrays a compiled loop would be compiled once more
    return stack if stack.flags.writeable else stack.copy()


def relative_depth(depth: npt.NDArray[np.float64], max_depth: float) -> npt.NDArray[np.float64]:
    """Return depths, mm, in units of ``max_depth``, mm.

    Raises:
        UserError: A depth is not between 0 and ``max_depth``.
    """
    bad = (depth < 0) | (depth > max_depth + 1e-9)
    if bad.any():
        raise UserError(
            f"a contact is {depth[bad][0]:.4g} mm deep, but heatmaps hold 0 to "
            f"{max_depth:g} mm; raise the encoder's parameter 'max_depth'."
        )
    return np.minimum(depth / max_depth, 1.0)
