"""Part a blob into the markers that touch in it, at necks of its shape."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

NECK = 0.7
"""Two markers are parted where the bridge is thinner than this multiple of the thicker one."""


def split(mask: npt.NDArray[np.bool_]) -> list[npt.NDArray[np.bool_]]:
    """The parts of one connected blob, as masks of the same shape (H, W); [mask] without a neck.

    A core is where the distance to the outside exceeds ``NECK`` times its greatest value; every
    pixel belongs to the nearest core.
    """
    import cv2

    padded = np.pad(mask, 1).astype(np.uint8)
    inside = cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    cores = (inside > NECK * inside.max()).astype(np.uint8)
    count, _, _, centres = cv2.connectedComponentsWithStats(cores, connectivity=8)
    if count == 2:
        return [mask]
    row, column = np.indices(mask.shape)
    away = [(column - x) ** 2 + (row - y) ** 2 for x, y in centres[1:]]
    nearest = np.argmin(away, axis=0)
    return [mask & (nearest == k) for k in range(count - 1)]
