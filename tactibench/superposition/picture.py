"""The picture of a sensor's pins, learned from frames, and frames drawn with moved pins."""

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
"""Number of bins of size, which are equally filled."""
_WINDOW_PX = 1.5
"""Standard deviation of the window in which the size of a pin is measured."""
_FRAMES = 200
"""Frames from which the picture is learned, spread evenly over all."""
_CLEAR = 0.6
"""A pixel farther from every pin than this share of the pins' spacing shows the background."""
_SMOOTH_PX = 4.0
"""Under pins that never move, the background is the mean of pixels around, weighted by a Gaussian
of this standard deviation."""
_WHITE = 255
"""Largest grey level."""


@dataclass(frozen=True, eq=False)
class PinPicture:
    """A picture of the background and of pins of several sizes.

    Attributes:
        background: (H, W) grey levels.
        light: (Z, B) grey levels of a pin over the background, by size and distance.
        sizes: (Z,) sizes as ``measure`` returns them, rising.
        noise: (2,): the variance of a pixel is noise[0] + noise[1] * grey.
        reach: Half the width of a pin's window, px.
    """

    background: Array
    light: Array
    sizes: Array
    noise: Array
    reach: int

    @classmethod
    def learn(cls, images: Images, pins: Array) -> Self:
        """Learn the picture from frames, of which a few hundred are enough.

        Args:
            images: (N, H, W) gray frames.
            pins: (N, P, 2) px, the places of their pins.
        """
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
        """Return the size of every pin, (N, P): its light in a Gaussian window, grey x px^2.

        Args:
            images: (N, H, W) gray frames.
            pins: (N, P, 2) px, the places of their pins.
        """
        out = np.empty(pins.shape[:2])
        for k, (image, xy) in enumerate(zip(images, pins, strict=True)):
            light, distance, inside = self._windows((image - self.background)[None], xy[None])
            window = np.exp(-0.5 * (distance / _WINDOW_PX) ** 2) * inside
            out[k] = (light * window).sum(axis=(-1, -2))[0]
        return out

    def draw(self, pins: Array, sizes: Array, rng: np.random.Generator) -> Images:
        """Return frames of pins, with noise, (N, H, W) uint8.

        Args:
            pins: (N, P, 2) px, the places of the pins.
            sizes: (N, P) sizes of the pins, as ``measure`` returns them.
            rng: Random numbers of the noise.
        """
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
        """Return the light of pins by distance and size, interpolated between bins."""
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
        """Return the windows of pins, (N, P, side, side).

        Returns:
            Light of every pixel, its distance from the pin, px, and whether it counts.
        """
        row, column, distance, inside = self._cells(pins)
        frame = np.arange(len(images))[:, None, None, None]
        return images[frame, row, column], distance, inside

    def _cells(
        self, pins: Array
    ) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], Array, npt.NDArray[np.bool_]]:
        """Return the pixels around pins (..., 2) px, (..., side, side).

        Returns:
            Row and column of every pixel, clipped to the frame, its distance from the pin, px, and
            whether it counts: it is in the frame and near enough.
        """
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
    """Return the mean level of every pixel over the frames in which no pin is near it, (H, W).

    Args:
        images: (N, H, W) gray frames.
        pins: (N, P, 2) px, the places of their pins.
        clear: Distance from every pin beyond which a pixel shows the background, px.
    """
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
    level: Array = np.where(count > 0.2 * len(images), total / np.maximum(count, 1), filled)
    return level


def _nearest(pins: Array) -> Array:
    """Return the distance of every pin to its nearest neighbour, (N, P) px."""
    from scipy.spatial import cKDTree

    return np.stack([cKDTree(places).query(places, k=2)[0][:, 1] for places in pins])


def _by_distance(distance: Array, value: Array, bins: int) -> Array:
    """Return the mean value by distance, (bins,).

    Empty bins are interpolated between filled ones, and the last bin is 0.
    """
    place = np.minimum((distance / _STEP_PX).astype(int), bins - 1)
    count = np.bincount(place, minlength=bins)
    total = np.bincount(place, value, minlength=bins)
    filled = np.flatnonzero(count)
    profile = np.interp(np.arange(bins), filled, total[filled] / count[filled])
    profile[-1] = 0.0
    return profile


def _noise(images: Images, clean: npt.NDArray[np.float32]) -> Array:
    """Return offset and slope of the noise's variance by grey level, (2,).

    They are fitted to robust variances of the residuals in eight equal groups of grey levels.

    Args:
        images: (N, H, W) gray frames.
        clean: (N, H, W) the same frames, drawn without noise.
    """
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
    """Return the variance of values within four robust standard deviations of the median.

    A median deviation alone would jump from one whole grey level to the next.
    """
    off = np.abs(values - np.median(values))
    inside = values[off <= 4 * 1.4826 * max(float(np.median(off)), 0.5)]
    return float(np.var(inside))
