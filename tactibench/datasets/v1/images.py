"""Images of a data set: bytes to be written, checked bytes read."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.datasets.v1.header import Header
from tactibench.errors import UserError
from tactibench.png import ImageKind, check_png, decode_png, encode_png, read_file


def kind_of(header: Header) -> ImageKind:
    """What every image of a data set is."""
    return ImageKind(*header.image, header.channels == 3)


def png_of(image: npt.NDArray[np.uint8] | bytes, header: Header, what: str) -> bytes:
    """The file of an image; bytes of a PNG are taken as they are.

    Raises UserError, which begins with ``what``, for an image that is not like the data set's.
    """
    kind = kind_of(header)
    if isinstance(image, bytes):
        found = check_png(what, image)
        if found != kind or image[24:26] not in (b"\x08\x00", b"\x08\x02"):
            raise UserError(f"{what} is not an 8-bit {kind} PNG without alpha; decode it first.")
        decode_png(what, image, kind)
        return image
    array: npt.NDArray[Any] = np.asarray(image)
    if array.dtype != np.uint8 or array.shape != kind.shape:
        raise UserError(
            f"{what} has the shape {array.shape} and type {array.dtype}, but this data set holds "
            f"{kind.shape} and uint8."
        )
    return encode_png(array)


def read_image(
    folder: Path, name: str, sha256: str, header: Header, where: str
) -> npt.NDArray[np.uint8]:
    """(H, W) or (H, W, 3) uint8 of a file of the data set.

    where: the line that names it. Raises UserError when the file is not what it was when it was
    written.
    """
    path = folder / name
    data = read_file(path)
    if hashlib.sha256(data).hexdigest() != sha256:
        what = _damage(path, data)
        raise UserError(f"{what} ({where}); restore it from a copy.")
    return decode_png(f"{path} ({where})", data, kind_of(header))


def _damage(path: Path, data: bytes) -> str:
    """How a file differs from the one that was written."""
    try:
        check_png(path, data)
    except UserError as error:
        return str(error).partition(";")[0]
    return f"{path} was changed after it was written (checksum)"
