"""Pictures as cameras write them: PNG, JPEG, BMP, TIFF, of 8 or 16 bits, and the frames of a video.

Frames of 8 bits in PNG files are kept byte for byte; everything else is decoded, and written into a
data set as PNG.
"""

from __future__ import annotations

import hashlib
import io
import re
import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactibench.errors import UserError, read_file
from tactibench.png import MOST_PIXELS, ImageKind, check_png, decode_png, encode_png
from tactibench.records import CacheEntry, cache_folder

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
VIDEOS = (".mp4", ".avi", ".mov", ".mkv", ".webm")
_BITS_AT = 24
"""Place of the byte in a PNG that holds the bits per channel."""
_GRAY = 2
"""Levels by which the colours of a gray video differ: decoding rounds."""
_REST = re.compile(r"(.*_)?(init|rest|reference|undeformed|no_?contact)(_?\d*)?", re.IGNORECASE)


def is_picture(path: Path, kinds: Sequence[str] = PICTURES) -> bool:
    """Return whether a file is a picture by its name; files that systems leave about are none."""
    return path.suffix.lower() in kinds and not path.name.startswith(".") and path.is_file()


def is_rest_name(path: Path) -> bool:
    """Return whether a file's name says that it shows the undeformed sensor."""
    return _REST.fullmatch(path.stem) is not None


def check_picture(path: Path, data: bytes) -> tuple[ImageKind, int]:
    """Return size and colours of a picture, and the bits of its brightest pixel, 0 for 8-bit ones.

    Raises:
        UserError: The file is no picture, is damaged, or has too many pixels.
    """
    if _is_usual(path, data):
        return check_png(path, data), 0
    image = _decode(path, data)
    kind = ImageKind(image.shape[0], image.shape[1], image.ndim == 3)
    return kind, max(1, int(image.max()).bit_length()) if image.dtype == np.uint16 else 0


def read_picture(path: Path, kind: ImageKind, bits: int) -> npt.NDArray[np.uint8]:
    """Return the pixels of a picture, (H, W) or RGB (H, W, 3) uint8, turned as it says.

    Args:
        path: The file.
        kind: Size and colours that it should have.
        bits: Bits of the brightest pixel of the recording, which become 8.

    Raises:
        UserError: The file cannot be decoded, or changed meanwhile.
    """
    data = read_file(path)
    if _is_usual(path, data):
        return decode_png(path, data, kind)
    image = _decode(path, data)
    if image.shape != kind.shape:
        raise UserError(f"{path} changed its size or colours meanwhile; restore it.")
    return (image >> (bits - 8)).astype(np.uint8)


def _is_usual(path: Path, data: bytes) -> bool:
    """Return whether a file is to be read as a PNG of at most 8 bits."""
    return path.suffix.lower() == ".png" and not (
        data[:4] == b"\x89PNG" and data[_BITS_AT:][:1] == b"\x10"
    )


def _decode(path: Path, data: bytes) -> npt.NDArray[np.uint8] | npt.NDArray[np.uint16]:
    from PIL import Image, ImageOps

    try:
        with Image.open(io.BytesIO(data)) as file:
            if file.width * file.height > MOST_PIXELS:
                raise UserError(
                    f"{path} cannot be decoded: it claims {file.height:,} x {file.width:,} pixels, "
                    f"allowed are {MOST_PIXELS:,}; replace it or remove its row."
                )
            image = ImageOps.exif_transpose(file)
            if image.mode.startswith("I"):
                deep = np.asarray(image)
                if deep.min() >= 0 and deep.max() < 2**16:
                    return deep.astype(np.uint16)
            gray = image.mode in ("1", "L", "LA")
            return np.asarray(image.convert("L" if gray else "RGB"), dtype=np.uint8)
    except (OSError, ValueError, SyntaxError, EOFError, struct.error, Image.DecompressionBombError):
        raise UserError(f"{path} cannot be decoded; replace it or remove its row.") from None


def video_frames(path: Path) -> Path:
    """Return a folder in the cache with the frames of a video, 0.png, 1.png, ....

    Raises:
        UserError: The video cannot be decoded.
    """
    import cv2

    sha256 = hashlib.sha256(read_file(path)).hexdigest()
    entry = CacheEntry(cache_folder() / "videos" / sha256[:24], {"video": sha256})

    def write(folder: Path) -> dict[str, int]:
        video, count = cv2.VideoCapture(str(path)), 0
        while (read := video.read())[0]:
            frame = np.ascontiguousarray(read[1][..., ::-1], dtype=np.uint8)
            is_gray = (np.ptp(frame, axis=2) <= _GRAY).all()
            image = frame[..., 1] if is_gray else frame
            (folder / f"{count}.png").write_bytes(encode_png(image))
            count += 1
        if not count:
            raise UserError(f"{path} cannot be decoded as a video; convert it to pictures.")
        return {"count": count}

    with entry.locked():
        if not entry.cached:
            entry.write(write)
    return entry.folder
