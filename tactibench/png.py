"""PNG files: a cheap check of the bytes, decoding and encoding (W3C PNG specification, section 5).

An image's pixels are counted before it is decoded, so that a small file cannot fill the memory.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactibench.errors import UserError

__all__ = ["ImageKind", "check_png", "decode_png", "encode_png"]

MOST_PIXELS = 64_000_000
"""Most pixels of one image: several times as many as cameras of tactile sensors have."""

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_HEADER = b"\x00\x00\x00\rIHDR"
_GRAY_TYPES = (0, 4)  # gray, gray with alpha


@dataclass(frozen=True)
class ImageKind:
    """Size and colours of an image.

    Attributes:
        height: Height, px.
        width: Width, px.
        colour: Whether it has colours.
    """

    height: int
    width: int
    colour: bool

    def __str__(self) -> str:
        return f"{self.height}x{self.width} {'colour' if self.colour else 'gray'}"

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the image's array: (H, W) or (H, W, 3)."""
        size = (self.height, self.width)
        return (*size, 3) if self.colour else size


def check_png(name: Path | str, data: bytes) -> ImageKind:
    """Check the chunks of a PNG and their checksums without decoding, and return its kind.

    Args:
        name: Name of the file, for errors.
        data: Bytes of the file.

    Raises:
        UserError: The file is no PNG, is cut short or is damaged.
    """
    view = memoryview(data)
    if not _has_header(data):
        raise UserError(f"{name} is not a PNG file; replace it or remove its row.")
    at, kind = 8, b""
    while kind != b"IEND":
        length = int.from_bytes(view[at : at + 4], "big")
        end = at + 12 + length
        if end > len(view):
            raise UserError(f"{name} is cut short; replace it or remove its row.")
        kind = bytes(view[at + 4 : at + 8])
        if zlib.crc32(view[at + 4 : end - 4]) != int.from_bytes(view[end - 4 : end], "big"):
            raise UserError(f"{name} is damaged (checksum); replace it or remove its row.")
        at = end
    return _kind(data)


def decode_png(name: Path | str, data: bytes, kind: ImageKind) -> npt.NDArray[np.uint8]:
    """Return the pixels of a PNG, (H, W) or RGB (H, W, 3) uint8.

    Args:
        name: Name of the file, for errors.
        data: Bytes of the file.
        kind: Size and colours that it should have.

    Raises:
        UserError: The data cannot be decoded as PNG, or have another size or more pixels than
            ``MOST_PIXELS``.
    """
    import cv2

    # Checked before memory is taken for the pixels: those of another format would not be counted.
    if not _has_header(data) or len(data) <= 25:
        raise UserError(f"{name} cannot be decoded as PNG; replace it or remove its row.")
    actual = _kind(data)
    if (actual.height, actual.width) != (kind.height, kind.width):
        raise UserError(
            f"{name} changed its size to {actual.height}x{actual.width} meanwhile, it was "
            f"{kind.height}x{kind.width}; restore it."
        )
    if kind.height * kind.width > MOST_PIXELS:
        raise UserError(
            f"{name} cannot be decoded: it claims {kind.height:,} x {kind.width:,} pixels, allowed "
            f"are {MOST_PIXELS:,}; replace it or remove its row."
        )
    mode = cv2.IMREAD_COLOR if kind.colour else cv2.IMREAD_GRAYSCALE
    try:
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), mode)
    except cv2.error:  # no bytes at all, or a header that OpenCV refuses
        image = None
    if image is None or image.shape != kind.shape:
        raise UserError(f"{name} cannot be decoded as PNG; replace it or remove its row.")
    if kind.colour:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
    return np.asarray(image, dtype=np.uint8)


def encode_png(image: npt.NDArray[np.uint8]) -> bytes:
    """Return the bytes of a PNG file of an (H, W) gray or (H, W, 3) RGB uint8 image."""
    import cv2

    if image.ndim == 3:
        image = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2BGR), dtype=np.uint8)
    # OpenCV's default level is the fastest, and its files are the smallest within 1 % (measured).
    _, data = cv2.imencode(".png", image)
    return data.tobytes()


def _has_header(data: bytes) -> bool:
    return data[:8] == _SIGNATURE and data[8:16] == _HEADER


def _kind(data: bytes) -> ImageKind:
    width, height = (int.from_bytes(data[i : i + 4], "big") for i in (16, 20))
    return ImageKind(height, width, data[25] not in _GRAY_TYPES)
