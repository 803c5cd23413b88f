"""The encoders ``hertz``, ``depth``, ``offset`` and ``mixture``.

``hertz`` is the depth-weighted Hertz-Gaussian heatmap of TactiVerse, "Data Preprocessing". A tip of
radius R at depth d has the Hertz contact radius a = sqrt(R d); the edge of the contact is taken as
3 sigma, so sigma_contact = a / 3, and the skin's compliance widens it:
sigma^2 = R d / 9 + sigma_blur^2. The height of the kernel is d / d_max.

``depth`` and ``offset`` are a heat of where contacts are, and discs of the rest. The heat of every
contact is a Gaussian of height 1 and one width, so that a shallow contact is as visible as a deep
one. In a disc around the contact other channels hold its depth and place: the
depth is constant in the disc, the steps to the contact are linear; outside they are neutral. A cell
between two contacts belongs to the nearer one. Every cell can be learned on its own, by
cross-entropy.

Reading takes the mean over the cells around a peak, weighted by heat, so that noise averages out.
Cells near the rim of a disc, or about as near to another peak, are left out, because networks blur
them.

All lengths in the compiled loops are in cells.

``mixture`` holds in each cell the probability, place and depth of a contact, and their std.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from numba import njit

from tactibench import Contacts, Grid, UserError
from tactibench_heatmaps.peaks import (
    TOLERANCE,
    MapEncoder,
    MapStack,
    PeakReader,
    relative_depth,
    split_contacts,
)

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

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


_BLOCK = 64
"""Maps rendered at a time, so that one block stays in the cache."""


class HertzGaussian(MapEncoder):
    """Contacts <-> one map of Gaussians: height d / max_depth, sigma^2 = R d / 9 + blur^2.

    The parameters are declared in ``hooks``. Kernels combine by maximum and are never rounded to a
    cell.

    The decoders are "maximum" as published, "least-squares" and "wide". For all but "maximum" a
    bump on the flank of a higher peak is no contact.

    The score of a contact is the heat of its peak, cut to 0..1: the deepest comes first.

    ``separation`` and ``tolerance`` hold for the default parameters on a 64 x 64 grid of 0.4 mm
    pitch and depths of 0.5 to 6 mm in any combination.
    """

    channels = 1
    separation = 6.5

    def __init__(
        self,
        *,
        max_depth: float = 6.0,
        radius: float = 3.0,
        blur: float = 2.0,
        decoder: str = "wide",
        threshold: float = 0.25 / 6.0,
        min_distance: float = 3.0,
        max_count: int = 6,
        width: str = "kernel",
    ) -> None:
        self.max_depth = max_depth
        self.peaks = PeakReader(
            slope=radius * max_depth / 9.0,
            base=blur**2,
            decoder=decoder,
            threshold=threshold,
            min_distance=min_distance,
            max_count=max_count,
            free=width == "free",
            flanks=decoder != "maximum",
        )
        self.tolerance = TOLERANCE[decoder]

    def encode_batch(self, contacts: Sequence[Contacts], grid: Grid) -> MapStack:
        """Return (N, 1, H, W) float32 maps.

        Raises:
            UserError: A depth is not between 0 and ``max_depth``.
        """
        maps = np.zeros((len(contacts), 1, *grid.shape), dtype=np.float32)
        counts = np.fromiter((len(c) for c in contacts), dtype=np.intp, count=len(contacts))
        if not counts.any():
            return maps
        xy = np.concatenate([c.xy for c in contacts])
        heat = relative_depth(np.concatenate([c.depth for c in contacts]), self.max_depth)
        x, y = grid.axes()
        scale = (-0.5 / (self.peaks.slope * heat + self.peaks.base))[:, None]
        along_x = np.exp(scale * (x - xy[:, :1]) ** 2).astype(np.float32)
        along_y = (heat[:, None] * np.exp(scale * (y - xy[:, 1:]) ** 2)).astype(np.float32)
        first = np.cumsum(counts) - counts
        for start in range(0, len(maps), _BLOCK):
            block = np.arange(start, min(start + _BLOCK, len(maps)))
            for k in range(counts[block].max()):
                rows = block[counts[block] > k]
                contact = first[rows] + k
                kernels = along_y[contact, :, None] * along_x[contact, None, :]
                maps[rows, 0] = np.maximum(maps[rows, 0], kernels) if k else kernels
        return maps

    def _decode(self, stack: MapStack, grid: Grid) -> list[Contacts]:
        peaks = self.peaks.read(stack[:, 0], grid.pitch)
        row, column, heat = peaks.flat(peaks.place).T
        depth, score = heat * self.max_depth, np.minimum(heat, 1.0)
        return split_contacts(peaks.counts, grid.xy(row, column), depth, score)


class Mixture(MapEncoder):
    """Contacts <-> 7 maps: presence, dx, dy, depth, and the std of x, y and depth.

    The cell nearest to a contact reports it: the probability that there is one, its distance from
    the cell's centre along x and y, its depth, and their standard deviations. All but the
    probability are mm. Maps like these are learned by the likelihood of
    ``tactibench.training.mixture_loss``, not cell by cell; coarse grids are enough. A contact
    without std has the std 0 on the map, and is read back without std.

    Neighbouring cells whose contacts lie within ``merge`` of each other report the same contact
    (``tactibench.training.MixtureReader``), so closer contacts are not told apart. The score of a
    contact is the sum of their probabilities; a contact whose score is below ``threshold`` is left
    out.

    Attributes:
        tolerance: Rounding to float32 up to 100 mm, mm.
    """

    channels = 7
    tolerance = 1e-5

    def __init__(self, *, threshold: float = 0.3, merge: float = 2.0, max_count: int = 6) -> None:
        from tactibench.training import MixtureReader  # heatmaps need none

        self._reader = MixtureReader(threshold, merge, max_count)
        self.separation = merge + self.tolerance

    def encode_batch(self, contacts: Sequence[Contacts], grid: Grid) -> MapStack:
        """Return (N, 7, H, W) float32 maps; a contact off the grid belongs to the nearest cell.

        Raises:
            UserError: A frame has more contacts than the grid has cells.
        """
        maps = np.zeros((len(contacts), self.channels, *grid.shape), dtype=np.float32)
        frame = np.repeat(np.arange(len(contacts)), [len(each) for each in contacts])
        if not len(frame):
            return maps
        xy = np.concatenate([each.xy for each in contacts])
        row, column = _cells(frame, xy, grid)
        columns = [
            np.concatenate([each.score for each in contacts]),
            *(xy - grid.xy(row, column)).T,
            np.concatenate([each.depth for each in contacts]),
            *np.concatenate([_stated_std(each) for each in contacts]).T,
        ]
        maps[frame, :, row, column] = np.stack(columns, axis=1)
        return maps

    def _decode(self, stack: MapStack, grid: Grid) -> list[Contacts]:
        from tactibench.training import FAINT

        frame, row, column = np.nonzero(stack[:, 0] >= FAINT)
        cells = stack[frame, :, row, column].astype(np.float64)
        mean = cells[:, 1:4]
        mean[:, :2] += grid.xy(row, column)
        frames = self._reader.read(len(stack), frame, cells[:, 0], mean, cells[:, 4:])
        return [_without_empty_std(contacts) for contacts in frames]


def _cells(frame: IntArray, xy: FloatArray, grid: Grid) -> tuple[IntArray, IntArray]:
    """Return row and column of the cell of every contact: the nearest that no other contact has.

    Raises:
        UserError: A frame has more contacts than the grid has cells.
    """
    rows, columns = grid.shape
    place = [np.rint(index).astype(np.intp) for index in grid.cells(xy)]
    cell = place[0].clip(0, rows - 1) * columns + place[1].clip(0, columns - 1)
    key = frame * rows * columns + cell
    for late in np.setdiff1d(np.arange(len(key)), np.unique(key, return_index=True)[1]):
        free = np.setdiff1d(np.arange(rows * columns), cell[frame == frame[late]])
        if not len(free):
            raise UserError(
                f"a frame has more contacts than the grid's {rows} x {columns} cells; take a grid "
                "with more cells."
            )
        away = np.square(grid.xy(*np.divmod(free, columns)) - xy[late]).sum(axis=1)
        cell[late] = free[away.argmin()]
    row, column = np.divmod(cell, columns)
    return row, column


def _stated_std(contacts: Contacts) -> FloatArray:
    return np.zeros((len(contacts), 3)) if contacts.std is None else contacts.std


def _without_empty_std(contacts: Contacts) -> Contacts:
    if contacts.std is not None and (contacts.std > 0).all():
        return contacts
    return Contacts(contacts.xy, contacts.depth, contacts.score)


_RIM = 1.0  # width inside the rim of a disc that is not read, cells
_LEAST_REACH = 2.0  # least radius of a disc, cells


class DiscEncoder(MapEncoder):
    """Contacts <-> heat and discs; the depth is the last channel, d / max_depth.

    Attributes:
        max_depth: Depth whose channel is 1, mm.
        reach: Radius of the discs, mm.
        peaks: How the heat is read, in mm.
    """

    def __init__(self, max_depth: float, reach: float, peaks: PeakReader) -> None:
        self.max_depth = max_depth
        self.reach = reach
        self.peaks = peaks

    def encode_batch(self, contacts: Sequence[Contacts], grid: Grid) -> MapStack:
        """Return (N, C, H, W) float32 maps.

        Raises:
            UserError: A depth is not between 0 and ``max_depth``, or the discs reach less than two
                cells.
        """
        out = np.empty((len(contacts), self.channels, *grid.shape), dtype=np.float32)
        ends = np.cumsum([0, *map(len, contacts)])
        xy = np.concatenate([np.empty((0, 2)), *(c.xy for c in contacts)])
        depth = np.concatenate([np.empty(0), *(c.depth for c in contacts)])
        place = np.column_stack([*grid.cells(xy), relative_depth(depth, self.max_depth)])
        draw_discs(place, ends, self.peaks.base / grid.pitch**2, self._reach(grid), out)
        return out

    def _decode(self, stack: MapStack, grid: Grid) -> list[Contacts]:
        peaks = self.peaks.read(stack[:, 0], grid.pitch)
        value = np.empty(peaks.place.shape[:2])
        reach = self._reach(grid)
        read_discs(stack, peaks.counts, peaks.place, reach - _RIM, reach, value)
        row, column, heat = peaks.flat(peaks.place).T
        depth = self.max_depth * peaks.flat(value)
        return split_contacts(peaks.counts, grid.xy(row, column), depth, np.minimum(heat, 1.0))

    def _reach(self, grid: Grid) -> float:
        cells = self.reach / grid.pitch
        if cells < _LEAST_REACH:
            raise UserError(
                f"the encoder's discs reach {self.reach:g} mm, less than {_LEAST_REACH:g} cells of "
                f"{grid.pitch:g} mm; raise its parameter 'reach'."
            )
        return cells


class HeatAndDepth(DiscEncoder):
    """Contacts <-> (2, H, W): a heat of height 1 at every contact, and discs of its depth.

    The parameters are declared in ``hooks``; the heat is read by the decoders of ``peaks``. The
    score of a contact is the heat of its peak, cut to 0..1.

    ``separation`` and ``tolerance`` hold for the default parameters on a 64 x 64 grid of 0.4 mm
    pitch and any depths.
    """

    channels = 2
    separation = 2.0

    def __init__(
        self,
        *,
        max_depth: float = 6.0,
        sigma: float = 0.8,
        reach: float = 2.0,
        decoder: str = "least-squares",
        threshold: float = 0.3,
        min_distance: float = 1.2,
        max_count: int = 6,
    ) -> None:
        peaks = PeakReader(
            slope=0.0,
            base=sigma**2,
            decoder=decoder,
            threshold=threshold,
            min_distance=min_distance,
            max_count=max_count,
            flanks=decoder != "maximum",
        )
        super().__init__(max_depth, reach, peaks)
        self.tolerance = TOLERANCE[decoder]


class Offsets(DiscEncoder):
    """Contacts <-> (4, H, W): heat, and discs of the steps dx, dy to the contact and of its depth.

    A step of -reach..reach is shown as 0..1. No step is 0.5, and so is every cell outside the
    discs. The contact is read from the mean of the steps of all cells around a peak of the heat, as
    in G-RMI (Papandreou et al., "Towards Accurate Multi-person Pose Estimation in the Wild", CVPR
    2017), whose offsets vote around the peaks of discs. The score is the heat of the peak, cut to
    0..1.

    The parameters are declared in ``hooks``. ``separation`` and ``tolerance`` hold for their
    defaults on a 64 x 64 grid of 0.4 mm pitch and any depths.
    """

    channels = 4
    separation = 2.0
    tolerance = 0.002

    def __init__(
        self,
        *,
        max_depth: float = 6.0,
        sigma: float = 0.8,
        reach: float = 2.0,
        threshold: float = 0.3,
        min_distance: float = 1.2,
        max_count: int = 6,
    ) -> None:
        peaks = PeakReader(
            slope=0.0,
            base=sigma**2,
            decoder="maximum",
            threshold=threshold,
            min_distance=min_distance,
            max_count=max_count,
        )
        super().__init__(max_depth, reach, peaks)
