"""Images in another shape."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def gray(image: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """(H, W) of (H, W) or RGB (H, W, 3) uint8, colours weighted as in ITU-R BT.601."""
    import cv2

    if image.ndim == 2:
        return image
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def resized(image: npt.NDArray[np.uint8], shape: tuple[int, int]) -> npt.NDArray[np.uint8]:
    """(H, W) uint8 in another shape: area averaging, linear where a side grows."""
    import cv2

    if image.shape == shape:
        return image
    shrink = image.shape[0] >= shape[0] and image.shape[1] >= shape[1]
    way = cv2.INTER_AREA if shrink else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, shape[::-1], interpolation=way), dtype=np.uint8)
