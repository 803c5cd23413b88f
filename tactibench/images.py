"""Conversion of frames to the arrays that models compute with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Frame
from tactibench.errors import UserError

_COLOURS = (1, 3, 4)
"""Numbers of channels of an image: grey, RGB, RGB with an alpha channel that is ignored."""
_ALMOST_BLACK = 2.0
"""A float image whose largest value lies between 1 and this value may be on either scale."""


def gray_frames(frames: Sequence[Frame], size: int) -> npt.NDArray[np.uint8]:
    """Return gray images, (N, size, size) uint8, resized by area averaging.

    Images may be (H, W), (H, W, C) or (C, H, W) with C = 1 (grey), 3 (RGB, weighted as in ITU-R
    BT.601) or 4 (RGB and alpha, which is ignored); uint8 or any integers in 0..255, booleans, or
    floats in 0..1 or 0..255.

    Args:
        frames: N frames.
        size: Height and width of the result, pixels.

    Raises:
        UserError: An image has another shape, type or range of values, holds NaN or infinity, or
            its sides have another ratio than those of its rest frame, so that it shows another
            view.
    """
    out = np.empty((len(frames), size, size), dtype=np.uint8)
    for number, (row, frame) in enumerate(zip(out, frames, strict=True), 1):
        image: npt.NDArray[Any] = frame.signal
        rest = image if frame.rest is None else frame.rest
        if rest.shape != image.shape and not _same_ratio(_sides(image), _sides(rest)):
            raise UserError(
                f"frame {number} of {len(frames)} has the shape {image.shape}, but its rest frame "
                f"{rest.shape}; another size of one view can be read, another crop cannot: take "
                "both with the same settings of the camera."
            )
        if not (image.ndim == 2 and image.dtype == np.uint8 and image.size):
            try:
                image = _levels(_channels_last(np.asarray(image)))
            except ValueError as error:
                raise UserError(f"frame {number} of {len(frames)} {error}") from None
            image = gray(image)
        row[...] = resized(image, (size, size))
    return out


def gray(image: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Return an (H, W) or RGB (H, W, 3) uint8 image in grey, (H, W), weighted as in BT.601."""
    import cv2

    if image.ndim == 2:
        return image
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def resized(image: npt.NDArray[np.uint8], shape: tuple[int, int]) -> npt.NDArray[np.uint8]:
    """Return an (H, W) uint8 image in another shape, by area averaging, or linear to enlarge it."""
    import cv2

    if image.shape == shape:
        return image
    shrink = image.shape[0] >= shape[0] and image.shape[1] >= shape[1]
    how = cv2.INTER_AREA if shrink else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, shape[::-1], interpolation=how), dtype=np.uint8)


def _sides(image: npt.NDArray[Any]) -> tuple[int, int]:
    """Return height and width, with channels first or last."""
    height, width = (*(image.shape[1:] if _channels_first(image) else image.shape), 1, 1)[:2]
    return height, width


def _same_ratio(one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Return whether two images may show one view: their sides are in proportion up to rounding."""
    return 2 * abs(one[0] * other[1] - one[1] * other[0]) < max(sum(one), sum(other))


def _channels_first(image: npt.NDArray[Any]) -> bool:
    return image.ndim == 3 and image.shape[2] not in _COLOURS and image.shape[0] in _COLOURS


def _channels_last(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return an image with channels first or last as (H, W) or (H, W, 3).

    Raises:
        ValueError: The shape is none of those of an image.
    """
    if _channels_first(image):
        image = np.moveaxis(image, 0, 2)
    good = image.ndim == 2 or (image.ndim == 3 and image.shape[2] in _COLOURS)
    if not good or not image.size:
        raise ValueError(
            f"has the shape {image.shape}; allowed are (H, W), (H, W, C) and (C, H, W) with 1, 3 "
            "or 4 channels; store it as grey or RGB."
        )
    if image.ndim == 3:
        image = image[..., 0] if image.shape[2] == 1 else image[..., :3]
    return np.ascontiguousarray(image)


def _levels(image: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """Return an image in levels 0..255.

    Raises:
        ValueError: The values are of another type or range, or not finite.
    """
    if image.dtype == np.uint8:
        return image
    if image.dtype == np.bool_:
        return np.where(image, 255, 0).astype(np.uint8)
    if image.dtype.kind not in "iuf":
        raise ValueError(f"holds {image.dtype} values; allowed are uint8 levels 0..255.")
    if not np.isfinite(image).all():
        raise ValueError("holds NaN or infinite values; leave it out or repair it.")
    low, high = float(image.min()), float(image.max())
    unclear = image.dtype.kind == "f" and 1 < high < _ALMOST_BLACK
    if low < 0 or high > 255 or unclear:
        floats = ", or floats in 0..1" if image.dtype.kind == "f" else ""
        raise ValueError(
            f"holds {image.dtype} values from {low:g} to {high:g}; allowed are levels in 0..255"
            f"{floats}; scale it first."
        )
    scale = 255 if image.dtype.kind == "f" and high <= 1 else 1
    levels: npt.NDArray[np.uint8] = np.rint(image * np.float64(scale)).astype(np.uint8)
    return levels
