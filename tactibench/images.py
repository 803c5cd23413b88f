"""Frames into the arrays that models compute with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Frame


def gray_frames(frames: Sequence[Frame], size: int) -> npt.NDArray[np.uint8]:
    """(N, size, size) uint8 gray images, resized by area averaging where the size differs.

    Colour frames (H, W, 3) are read as RGB and weighted as in ITU-R BT.601.
    """
    import cv2

    out = np.empty((len(frames), size, size), dtype=np.uint8)
    for row, frame in zip(out, frames, strict=True):
        image: npt.NDArray[Any] = frame.image
        if image.ndim == 3:
            image = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        if image.shape != (size, size):
            shrink = image.shape[0] >= size and image.shape[1] >= size
            way = cv2.INTER_AREA if shrink else cv2.INTER_LINEAR
            image = cv2.resize(image, (size, size), interpolation=way)
        row[...] = image
    return out
