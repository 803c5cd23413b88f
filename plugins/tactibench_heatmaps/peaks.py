"""Peaks of heatmaps, and the base of the encoders, which checks maps before they are read.

``PeakReader`` defines a peak, and describes how its place between cells is found. In the compiled
loops everything is in cells; the variance of a peak of heat h is ``slope * h + base``.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from numba import njit

from tactibench import Contacts, Encoder, Grid, UserError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
MapStack = npt.NDArray[np.float32]

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
        theta, fitted = fitted, theta
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


WINDOW = {"least-squares": 11, "wide": 17}
"""Cells a side that a decoder fits; 17 are 4 sigma of the default heat to either side."""
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
            half = WINDOW[self.decoder] // 2
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
