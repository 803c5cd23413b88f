"""Bright spots of one frame: found, painted over, drawn."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactibench.images import gray
from tactibench.markers.blobs import FAINTEST

Image = npt.NDArray[np.uint8]
Labels = npt.NDArray[np.int32]

EDGE = 2
"""Pixels around a blob that its soft edge reaches."""
AROUND = 8
"""Half the side of the window, px, whose dark pixels replace those of a blob."""
SPECK = 0.25
"""Blobs below this share of the median area are noise."""


def pin_labels(image: Image) -> tuple[Labels, int]:
    """(H, W) number of the bright blob that a pixel belongs to, 0 for none, and how many there are.

    Brighter than Otsu's threshold (IEEE Trans. SMC 9, 1979), joined by sides; none in a frame whose
    contrast is too small to hold pins.
    """
    import cv2

    level = gray(image)
    if int(level.max()) - int(level.min()) < FAINTEST:
        return np.zeros(level.shape, np.int32), 0
    _, bright = cv2.threshold(level, 0, 1, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    _, found = cv2.connectedComponents(bright, connectivity=4, ltype=cv2.CV_32S)
    area = np.bincount(found.ravel())
    kept = np.flatnonzero(area[1:] >= SPECK * np.median(area[1:])) + 1
    number = np.zeros(len(area), np.int32)
    number[kept] = np.arange(1, len(kept) + 1)
    return number[found], len(kept)


def repainted(
    image: Image, labels: Labels, which: npt.NDArray[np.intp], rng: np.random.Generator
) -> Image:
    """The image with some blobs painted over by pixels drawn from the dark ones around each.

    Noise and shading of the gel stay what they are there.
    """
    import cv2

    out = image.copy()
    square = np.ones((2 * EDGE + 1, 2 * EDGE + 1), np.uint8)
    dark = cv2.dilate((labels > 0).astype(np.uint8), square) == 0
    if not dark.any():
        dark = labels == 0
    for number in which:
        own = labels == number
        rows, columns = np.nonzero(own)
        window = (
            slice(max(0, rows.min() - AROUND), rows.max() + AROUND + 1),
            slice(max(0, columns.min() - AROUND), columns.max() + AROUND + 1),
        )
        blob = cv2.dilate(own[window].astype(np.uint8), square) > 0
        blob &= (labels[window] == 0) | own[window]
        here = dark[window] if dark[window].any() else labels[window] == 0
        out[window][blob] = rng.choice(image[window][here], int(blob.sum()))
    return out


def discs(
    shape: tuple[int, ...], places: npt.NDArray[np.float64], radius: float
) -> npt.NDArray[np.float64]:
    """(H, W) in 0..1, discs of ``radius`` px at (row, column) places with edges a pixel wide."""
    rows, columns = (np.arange(n, dtype=np.float64) for n in shape)
    cover = np.zeros(shape)
    for row, column in places:
        away = np.hypot(rows[:, None] - row, columns[None] - column)
        np.maximum(cover, np.clip(radius + 0.5 - away, 0, 1), out=cover)
    return cover
