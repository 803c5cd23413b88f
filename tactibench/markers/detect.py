"""Bright blobs of a frame: threshold, connected components, intensity-weighted centroids."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.errors import UserError
from tactibench.markers.split import split

Array = npt.NDArray[np.float64]

FAINTEST = 20
"""Grey levels between darkest and brightest pixel below which a frame holds no marker."""
SMALLEST, LARGEST = 0.3, 4.5
"""Blobs beyond these multiples of the usual area are specks, glare or the rim of the dome."""
MERGED = 1.6
"""From this multiple of the usual area on a blob is looked at for a neck."""


@dataclass(frozen=True, eq=False)
class Markers:
    """What was found in one frame.

    xy: (N, 2) centroids, px; pixel (row i, column j) has its centre at x = j, y = i.
    area: (N,) px.
    """

    xy: Array
    area: Array

    def __len__(self) -> int:
        return len(self.area)


def detect(image: npt.NDArray[np.uint8]) -> Markers:
    """The bright blobs of a black-and-white or grey frame (H, W) uint8.

    The threshold is Otsu's; blobs that touch are parted where their shape has a neck. A pixel
    weighs what it exceeds the dark level by, and the rim of dimmer pixels around a blob counts, so
    soft edges give sub-pixel centroids. Raises UserError for any other array.
    """
    import cv2

    if image.ndim != 2 or image.dtype != np.uint8:
        raise UserError(
            f"the frame has shape {image.shape} and type {image.dtype}; "
            "markers are found in a gray frame (H, W) of uint8."
        )
    if not image.size or int(image.max()) - int(image.min()) < FAINTEST:
        return Markers(np.empty((0, 2)), np.empty(0))
    threshold, bright = cv2.threshold(image, 0, 1, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    count, labels, boxes, middles = cv2.connectedComponentsWithStats(bright, connectivity=4)
    area = boxes[:, cv2.CC_STAT_AREA].astype(np.float64)
    area[0] = 0.0
    kept = (area > SMALLEST * _usual(area)) & (area < LARGEST * _usual(area))
    for label in np.flatnonzero(kept & (area > MERGED * _usual(area))):
        left, top, width, height = boxes[label, :4]
        window = labels[top : top + height, left : left + width]
        for part in split(window == label)[1:]:
            window[part] = count
            count += 1
    grey = np.count_nonzero(np.bincount(image.ravel(), minlength=256)) > 2
    if not grey and count == len(kept):
        return Markers(np.asarray(middles[kept], dtype=np.float64), area[kept])
    kept = np.concatenate([kept, np.ones(count - len(kept), dtype=np.bool_)])
    if grey:  # the dimmer pixels of a soft edge belong to the blob they touch
        grown = cv2.dilate(labels.astype(np.float32), np.ones((3, 3), np.uint8)).astype(np.int32)
        labels = np.where(labels == 0, grown, labels)
    return _centroids(image, labels, kept, threshold)


def _usual(area: Array) -> float:
    """The median area of blobs that are no specks, px; specks may outnumber the markers."""
    there = area[area > 0]
    return float(np.median(there[there >= there.mean() / 4]) if len(there) else 0.0)


def _centroids(
    image: npt.NDArray[np.uint8],
    labels: npt.NDArray[Any],
    kept: npt.NDArray[np.bool_],
    threshold: float,
) -> Markers:
    dim = image[image <= threshold]
    dark = float(dim.mean()) if len(dim) else 0.0
    place = np.flatnonzero(labels)
    blob = labels.ravel()[place]
    weight = np.maximum(image.ravel()[place] - dark, 0.0)
    row, column = np.divmod(place, image.shape[1])
    total, right, down = (
        np.bincount(blob, w, minlength=len(kept))[kept]
        for w in (weight, weight * column, weight * row)
    )
    area = np.bincount(blob[image.ravel()[place] > threshold], minlength=len(kept))[kept]
    return Markers(np.stack([right / total, down / total], axis=1), area.astype(np.float64))
