"""The picture of a sensor's pins, learned from frames, and frames drawn with pins elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.uint8]

_STEP_PX = 0.1
"""Width of the bins of distance."""
_SIZES = 12
"""Bins of size, equally filled."""
_WINDOW_PX = 1.5
"""Standard deviation of the window in which the size of a pin is measured."""
_FRAMES = 200
"""Frames from which the look is learned, spread evenly over all."""
_CLEAR = 0.6
"""A pixel farther from every pin than this share of the pins' spacing shows the background."""
_SMOOTH_PX = 4.0
"""Under pins that never move the background is that of pixels around, weighted by a Gaussian."""
_WHITE = 255


@dataclass(frozen=True, eq=False)
class PinPicture:
    """A picture of the background and of pins of several sizes."""

    background: Array
    """(H, W) grey levels."""
    light: Array
    """(Z, B) grey levels of a pin of a size at a distance."""
    sizes: Array
    """(Z,) as ``measure`` gives them, rising."""
    noise: Array
    """(2,): the variance of a pixel is noise[0] + noise[1] * grey."""
    reach: int
    """Half a pin's window, px."""

    @classmethod
    def learn(cls, images: Images, pins: Array) -> Self:
        """Learn from frames (N, H, W) and their pins (N, P, 2) px; a few hundred are enough."""
        some = np.unique(np.linspace(0, len(images) - 1, min(_FRAMES, len(images))).astype(int))
        images, pins = images[some], pins[some]
        apart = _nearest(pins)
        reach = max(2, int(np.ceil(0.5 * np.median(apart))))
        background = _background(images, pins, _CLEAR * float(np.median(apart)))
        empty = cls(background, np.zeros((1, 1)), np.ones(1), np.zeros(2), reach)
        size = empty.measure(images, pins)
        light, distance, inside = empty._windows(images - background, pins)
        free = apart > 1.7 * reach
        bins = int(reach / _STEP_PX) + 2
        groups = np.array_split(np.argsort(size[free]), _SIZES)
        groups = [group for group in groups if len(group)]
        near, value, counts = distance[free], light[free], inside[free]
        table = [
            _by_distance(near[group][counts[group]], value[group][counts[group]], bins)
            for group in groups
        ]
        sizes = np.array([size[free][group].mean() for group in groups])
        drawn = cls(background, np.stack(table), sizes, np.zeros(2), reach)
        noise = _noise(images, drawn._clean(pins, size))
        return cls(background, drawn.light, sizes, noise, reach)

    def measure(self, images: Images, pins: Array) -> Array:
        """Return (N, P) the size of every pin: its light in a Gaussian window, grey x px^2."""
        out = np.empty(pins.shape[:2])
        for k, (image, xy) in enumerate(zip(images, pins, strict=True)):
            light, distance, inside = self._windows((image - self.background)[None], xy[None])
            window = np.exp(-0.5 * (distance / _WINDOW_PX) ** 2) * inside
            out[k] = (light * window).sum(axis=(-1, -2))[0]
        return out

    def draw(self, pins: Array, sizes: Array, rng: np.random.Generator) -> Images:
        """Return (N, H, W) uint8 frames of pins (N, P, 2) px of sizes (N, P), with noise."""
        clean = self._clean(pins, sizes)
        spread = np.sqrt(np.maximum(self.noise[0] + self.noise[1] * clean, 0.0))
        noisy = clean + spread * rng.standard_normal(clean.shape, dtype=np.float32)
        frames: Images = np.rint(noisy).clip(0, _WHITE).astype(np.uint8)
        return frames

    def _clean(self, pins: Array, sizes: Array) -> npt.NDArray[np.float32]:
        height, width = self.background.shape
        out = np.empty((len(pins), height, width), dtype=np.float32)
        for k in range(len(pins)):
            row, column, distance, inside = self._cells(pins[k])
            light = (self._profile(distance, sizes[k, :, None, None]) * inside).ravel()
            cell = (row * width + column).ravel()
            drawn = np.bincount(cell, light, minlength=height * width).reshape(height, width)
            out[k] = self.background + drawn
        return out

    def _profile(self, distance: Array, sizes: Array) -> Array:
        """Light by distance, between the two bins of distance and of size around."""
        place = (distance / _STEP_PX - 0.5).clip(0, self.light.shape[1] - 1.001)
        size = np.interp(sizes, self.sizes, np.arange(len(self.sizes), dtype=np.float64))
        size = size.clip(0, max(len(self.sizes) - 1.001, 0.0))
        i, j = size.astype(np.intp), place.astype(np.intp)
        u, v = size - i, place - j
        table = self.light
        k = np.minimum(i + 1, len(table) - 1)
        near = (1 - u) * table[i, j] + u * table[k, j]
        far = (1 - u) * table[i, j + 1] + u * table[k, j + 1]
        value: Array = (1 - v) * near + v * far
        return value

    def _windows(self, images: Array, pins: Array) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
        """Light, distance from the pin and whether it counts, (N, P, side, side)."""
        row, column, distance, inside = self._cells(pins)
        frame = np.arange(len(images))[:, None, None, None]
        return images[frame, row, column], distance, inside

    def _cells(
        self, pins: Array
    ) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], Array, npt.NDArray[np.bool_]]:
        """Row and column of the pixels around pins (..., 2), clipped to the frame; see _windows."""
        height, width = self.background.shape
        steps = np.arange(-self.reach, self.reach + 1)
        middle = np.rint(pins).astype(np.intp)
        row = middle[..., 1, None, None] + steps[:, None] + 0 * steps
        column = middle[..., 0, None, None] + 0 * steps[:, None] + steps
        distance = np.hypot(column - pins[..., 0, None, None], row - pins[..., 1, None, None])
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        inside &= distance < self.reach
        return row.clip(0, height - 1), column.clip(0, width - 1), distance, inside


def _background(images: Images, pins: Array, clear: float) -> Array:
    """(H, W) mean grey level of every pixel over the frames in which no pin is near it."""
    import cv2

    total, count = np.zeros(images.shape[1:]), np.zeros(images.shape[1:])
    for image, xy in zip(images, pins, strict=True):
        covered = np.full(image.shape, 255, dtype=np.uint8)
        inside = (xy >= 0).all(axis=1) & (xy < image.shape[::-1]).all(axis=1)
        column, row = np.rint(xy[inside]).astype(int).T
        covered[row.clip(max=image.shape[0] - 1), column.clip(max=image.shape[1] - 1)] = 0
        free = cv2.distanceTransform(covered, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) > clear
        total += image * free
        count += free
    side = (0, 0)
    around = cv2.GaussianBlur(total, side, _SMOOTH_PX), cv2.GaussianBlur(count, side, _SMOOTH_PX)
    filled = around[0] / np.maximum(around[1], 1e-9)
    own: Array = np.where(count > 0.2 * len(images), total / np.maximum(count, 1), filled)
    return own


def _nearest(pins: Array) -> Array:
    """(N, P) px from every pin to the nearest other one."""
    from scipy.spatial import cKDTree

    return np.stack([cKDTree(places).query(places, k=2)[0][:, 1] for places in pins])


def _by_distance(distance: Array, value: Array, bins: int) -> Array:
    """(bins,) mean value by distance; empty bins take the nearest filled one's."""
    place = np.minimum((distance / _STEP_PX).astype(int), bins - 1)
    count = np.bincount(place, minlength=bins)
    total = np.bincount(place, value, minlength=bins)
    filled = np.flatnonzero(count)
    profile = np.interp(np.arange(bins), filled, total[filled] / count[filled])
    profile[-1] = 0.0
    return profile


def _noise(images: Images, clean: npt.NDArray[np.float32]) -> Array:
    """Variance by grey level: robust spread of what the drawing leaves, in eight equal groups."""
    left = (images - clean).ravel()
    grey = clean.ravel()
    some = slice(None, None, max(1, len(left) // 400_000))
    order = np.argsort(grey[some])
    groups = [part for part in np.array_split(order, 8) if len(part)]
    level = np.array([grey[some][part].mean() for part in groups])
    spread = np.array([_variance(left[some][part]) for part in groups])
    slope, floor = np.polyfit(level, spread, 1) if len(groups) > 1 else (0.0, spread[0])
    return np.array([max(floor, 0.0), max(slope, 0.0)])


def _variance(values: npt.NDArray[np.floating]) -> float:
    """Variance without what lies beyond four robust deviations of the median.

    A median deviation alone would jump from one whole grey level to the next.
    """
    off = np.abs(values - np.median(values))
    inside = values[off <= 4 * 1.4826 * max(float(np.median(off)), 0.5)]
    return float(np.var(inside))
