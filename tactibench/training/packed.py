"""A gray image as text, to be kept in the JSON beside weights."""

from __future__ import annotations

import base64
import zlib

import numpy as np
import numpy.typing as npt

from tactibench.errors import UserError

Image = npt.NDArray[np.uint8]


def pack_image(image: Image) -> str:
    """An (H, W) uint8 image as "H W levels", the levels compressed and in base 85."""
    height, width = image.shape
    levels = base64.b85encode(zlib.compress(image.tobytes(), 9)).decode("ascii")
    return f"{height} {width} {levels}"


def unpack_image(text: str) -> Image:
    """The (H, W) uint8 image of a text of ``pack_image``. Raises UserError for any other text."""
    try:
        height, width, levels = text.split(" ")
        flat = np.frombuffer(zlib.decompress(base64.b85decode(levels)), dtype=np.uint8)
        return flat.reshape(int(height), int(width)).copy()
    except (ValueError, zlib.error) as error:
        raise UserError(
            f"an image kept beside the weights cannot be read: {error}; train the model again."
        ) from error
