"""RTDE packages: framing, types, packing; all big-endian (UR: Real-Time Data Exchange)."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from typing import Any

HEADER = struct.Struct(">HB")
VERSION, URCONTROL, TEXT, DATA, OUTPUTS, INPUTS, START, PAUSE = (ord(c) for c in "VvMUOISP")
NOT_FOUND, IN_USE = "NOT_FOUND", "IN_USE"
LONGEST_NAMES = 2048

_FORMATS = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "INT32": "i",
    "UINT64": "Q",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}


def packed(kind: int, payload: bytes, *, wrong_by: int = 0) -> bytes:
    """A package; wrong_by: what a fault adds to its length."""
    return HEADER.pack(HEADER.size + len(payload) + wrong_by, kind) + payload


class Splitter:
    """Bytes in any portions into packages."""

    def __init__(self) -> None:
        self._waiting = b""

    def feed(self, data: bytes) -> Iterator[tuple[int, bytes]]:
        """(type, payload) of every package that is whole. Raises ValueError for a length that
        cannot be."""
        self._waiting += data
        while len(self._waiting) >= HEADER.size:
            size, kind = HEADER.unpack_from(self._waiting)
            if size < HEADER.size:
                raise ValueError(f"a package of {size} bytes is shorter than its header")
            if len(self._waiting) < size:
                return
            payload, self._waiting = self._waiting[HEADER.size : size], self._waiting[size:]
            yield kind, payload


def pack_values(types: Sequence[str], values: Sequence[Any]) -> bytes:
    """Values in the order of the recipe; a vector is a sequence."""
    out = []
    for kind, value in zip(types, values, strict=True):
        code = ">" + _FORMATS[kind]
        out.append(struct.pack(code, *value) if code[1].isdigit() else struct.pack(code, value))
    return b"".join(out)


def unpack_values(types: Sequence[str], data: bytes) -> list[Any]:
    """The inverse. Raises ValueError where the length does not fit."""
    codes = [">" + _FORMATS[kind] for kind in types]
    if sum(map(struct.calcsize, codes)) != len(data):
        raise ValueError(f"{len(data)} bytes do not hold {', '.join(types)}")
    values, at = [], 0
    for code in codes:
        found = struct.unpack_from(code, data, at)
        values.append(found if code[1].isdigit() else found[0])
        at += struct.calcsize(code)
    return values


def text_message(version: int, text: str, source: str = "RTDE", level: int = 2) -> bytes:
    """level: 0 exception, 1 error, 2 warning, 3 info."""
    message, origin = text.encode()[:255], source.encode()[:255]
    if version == 1:
        return packed(TEXT, bytes([level]) + message)
    parts = bytes([len(message)]) + message + bytes([len(origin)]) + origin
    return packed(TEXT, parts + bytes([level]))
