"""A gray image as text, to be kept beside weights."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
import numpy.typing as npt


def packed_image(image: npt.NDArray[np.uint8]) -> dict[str, Any]:
    """JSON values of an image (H, W) uint8: its shape and its compressed levels."""
    levels = base64.b64encode(zlib.compress(image.tobytes(), 9)).decode("ascii")
    return {"shape": list(image.shape), "levels": levels}


def unpacked_image(values: dict[str, Any]) -> npt.NDArray[np.uint8]:
    """The image (H, W) uint8 whose ``packed_image`` these values are."""
    levels = zlib.decompress(base64.b64decode(values["levels"]))
    return np.frombuffer(levels, dtype=np.uint8).reshape(values["shape"]).copy()
