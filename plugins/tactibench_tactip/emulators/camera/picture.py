"""What the camera makes of the sensor's image: light, missing pins, noise."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
FIELDS = 8
READ, FULL_WELL, WHITE = 1.5, 10_000.0, 255
"""Noise of variance read^2 + 255 / full_well * grey (EMVA 1288, linear model): read in grey levels
rms, full well in electrons; those of a small CMOS pixel, assumed."""


class Picture:
    """Noise and pins of one camera. rest: (H, W) or (H, W, 3), without noise."""

    def __init__(self, rest: Image, noise: float, seed: int) -> None:
        """noise: times the camera's own; 0: none."""
        self._rng = np.random.default_rng(seed)
        shape = (FIELDS, *rest.shape)
        self._fields = self._rng.standard_normal(shape, dtype=np.float32) * np.float32(noise)
        self._noisy = noise > 0
        grey = np.arange(WHITE + 1, dtype=np.float32)
        self._deviation = np.sqrt(READ**2 + WHITE / FULL_WELL * grey)
        self._places = _pins(rest)[1]
        self._lost = np.zeros((0, 2))

    @property
    def pins(self) -> int:
        """How many pins it sees at rest."""
        return len(self._places)

    def lose(self, count: int) -> None:
        """From now on so many pins more are missing."""
        left = [p for p in self._places if not (self._lost == p).all(axis=1).any()]
        picked = self._rng.permutation(len(left))[:count]
        self._lost = np.concatenate([self._lost, np.array(left)[picked].reshape(-1, 2)])

    def frame(self, image: Image, brighter: float = 0.0, black: bool = False) -> Image:
        """One frame, uint8, with noise of its own."""
        seen: Image = np.zeros_like(image) if black else image
        if len(self._lost) and not black:
            seen = _without(seen, self._lost)
        if brighter and not black:
            seen = _rounded(seen.astype(np.float32) + brighter)
        if not self._noisy:
            return seen
        field = self._fields[int(self._rng.integers(FIELDS))]
        rolled = np.roll(field, tuple(self._rng.integers(0, 64, 2)), axis=(0, 1))
        return _rounded(seen + self._deviation[seen] * rolled)


def _rounded(values: npt.NDArray[Any]) -> Image:
    out: Image = np.clip(np.rint(values), 0, WHITE).astype(np.uint8)
    return out


def _pins(image: Image) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float64]]:
    """Labels (H, W) of the blobs and their centres (N, 2) in px: the rarer side of Otsu's
    threshold."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    _, mask = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    if mask.mean() > WHITE / 2:
        mask = cv2.bitwise_not(mask)
    _, labels, _, centres = cv2.connectedComponentsWithStats(mask)
    return np.asarray(labels), np.asarray(centres[1:], dtype=np.float64)


def _without(image: Image, places: npt.NDArray[np.float64]) -> Image:
    """Without the blob that is nearest to every place, each taken once."""
    labels, centres = _pins(image)
    gone = np.zeros(labels.shape, dtype=np.uint8)
    free = np.ones(len(centres), dtype=bool)
    for place in places[: len(centres)]:
        distance = np.where(free, np.hypot(*(centres - place).T), np.inf)
        nearest = int(distance.argmin())
        free[nearest] = False
        gone |= (labels == nearest + 1).astype(np.uint8)
    gone = np.asarray(cv2.dilate(gone, np.ones((3, 3), np.uint8)))
    background = np.median(image[labels == 0], axis=0)
    out = image.copy()
    out[gone > 0] = background.astype(np.uint8)
    return out
