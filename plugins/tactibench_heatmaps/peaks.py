"""Peaks of heatmaps, and where between the cells they are.

A peak is a maximum of the multidimensional maximum filter (TactiVerse, "Height Scaling") that
reaches the threshold. The filter's window is 3 x 3 cells: a larger one would hide a shallow contact
behind the flank of a deep neighbour. Which peaks are too close is decided between peaks, by their
distance; of two the higher stays. A plateau is one peak, at its cell nearest to its centre; a map
without any lower cell has none.

Four decoders say where the peak is:

``maximum``: the centre of the cell, and its heat.

``least-squares``: around each peak, log-heat is the paraboloid l(u) = t . [1, u_x, u_y, |u|^2].
Heat h is taken to carry noise of equal size in every cell, so log-heat is weighted by m^2, with
m = exp(l) the heat that the current estimate predicts. For the same reason the logarithm, which
noise near zero would ruin, is replaced by its tangent at m: log h ~ l + (h - m) / m. This is
Gauss-Newton on heat, and two steps from the kernel at the peak's cell suffice. Cells where another
peak predicts more heat belong to that one and are left out, so that neighbours do not pull at each
other. A fit that is not concave, strays, or is far from the kernel gives way to a parabola through
three cells an axis, and that to the cell itself.

``wide``: the same over ``WIDE`` cells a side.

In both, the curvature is free or that of the kernel whose height the estimate has, which is then
linearised in the height like the rest. The latter reads networks better that have learned to draw
the kernel; a free curvature reads the heat of peaks of another width correctly.

``dark``: Zhang et al., "Distribution-Aware Coordinate Representation for Human Pose Estimation",
CVPR 2020: the map is blurred by a Gaussian of 2 cells over 11 x 11 cells, and the second-order
Taylor expansion of its logarithm at the peak's cell is maximised, with the differences of the
published code. The height lost to the blur is restored for the known kernel. The blur reaches into
neighbours; peaks within seven cells of the border are read by three cells an axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from tactibench import Contacts
from tactibench_heatmaps.encoder import MapStack
from tactibench_heatmaps.least_squares import fit_maps
from tactibench_heatmaps.maxima import find_peaks

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

WIDE = 17
"""Cells a side that the decoder `wide` fits: 4 sigma of the default heat to either side."""
# round-trip error, mm on cells of 0.4 mm: half a cell; differences of a blurred map; two steps
TOLERANCE = {"maximum": 0.201, "dark": 0.01, "least-squares": 0.002, "wide": 0.002}
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
        decoder: "maximum", "least-squares", "wide" or "dark".
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
        if self.decoder == "dark":
            from tactibench_heatmaps.dark import expand_maps

            expand_maps(maps, stray, slope, base, counts, place)
        elif self.decoder != "maximum":
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
