"""PNG files: a cheap check of the bytes, and decoding (W3C PNG specification, section 5)."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from tactibench import UserError

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_HEADER = b"\x00\x00\x00\rIHDR"
_GRAY_TYPES = (0, 4)  # gray, gray with alpha


@dataclass(frozen=True)
class ImageKind:
    """Height and width in pixels, and whether it has colours."""

    height: int
    width: int
    colour: bool

    def __str__(self) -> str:
        return f"{self.height}x{self.width} {'colour' if self.colour else 'gray'}"


def read_file(path: Path) -> bytes:
    """The bytes of a file. Raises UserError when it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror or error}.") from None


def check_png(path: Path, data: bytes) -> ImageKind:
    """Walk the chunks of a PNG from header to end, checksums included; nothing is decoded.

    Raises UserError for a file that is no PNG, is cut short or is damaged.
    """
    view = memoryview(data)
    if view[:8] != _SIGNATURE or view[8:16] != _HEADER:
        raise UserError(f"{path} is not a PNG file; replace it or remove its row.")
    at, kind = 8, b""
    while kind != b"IEND":
        length = int.from_bytes(view[at : at + 4], "big")
        end = at + 12 + length
        if end > len(view):
            raise UserError(f"{path} is cut short; replace it or remove its row.")
        kind = bytes(view[at + 4 : at + 8])
        if zlib.crc32(view[at + 4 : end - 4]) != int.from_bytes(view[end - 4 : end], "big"):
            raise UserError(f"{path} is damaged (checksum); replace it or remove its row.")
        at = end
    width, height = (int.from_bytes(view[i : i + 4], "big") for i in (16, 20))
    return ImageKind(height, width, view[25] not in _GRAY_TYPES)


def decode_png(path: Path, kind: ImageKind) -> npt.NDArray[np.uint8]:
    """(H, W) or RGB (H, W, 3) uint8. Raises UserError when the file is not what it was."""
    data = np.frombuffer(read_file(path), dtype=np.uint8)
    way = cv2.IMREAD_COLOR if kind.colour else cv2.IMREAD_GRAYSCALE
    try:
        image = cv2.imdecode(data, way)
    except cv2.error:  # no bytes at all, or a header that claims more pixels than OpenCV allows
        image = None
    if image is None:
        raise UserError(f"{path} cannot be decoded as PNG; replace it or remove its row.")
    if image.shape[:2] != (kind.height, kind.width):
        raise UserError(f"{path} changed its size to {image.shape[0]}x{image.shape[1]} meanwhile.")
    if kind.colour:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
    return np.asarray(image, dtype=np.uint8)
