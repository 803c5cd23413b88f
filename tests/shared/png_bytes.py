"""PNG files that say of themselves what a test wants."""

from __future__ import annotations

import struct
import zlib


def png(width: int, height: int, pixels: bytes, bits: int = 8) -> bytes:
    """A gray PNG with sound checksums around any bytes that claim to be pixels."""
    chunks = {
        b"IHDR": struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0),
        b"IDAT": pixels,
        b"IEND": b"",
    }
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks.items()
    )
