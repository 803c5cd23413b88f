"""Valid files with something wrong in them: bytes, tokens, JSON values, fitting checksums."""

from __future__ import annotations

import io
import json
import random
import re
import zlib
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

Random = random.Random
Mutation = Callable[[Random, bytes], bytes]

TOKENS = (
    "nan",
    "-inf",
    "-1",
    "0",
    str(10**400),
    "true",
    "null",
    '""',
    '"\\ud800"',
    "\x00",
    "\n",
    ",",
    ";",
    "{" * 3000,
    "[" * 3000,
    '"../../etc/passwd"',
    "/dev/zero",
    "[[draws]]",
    "=",
    "1979-05-27",
)
VALUES: tuple[Any, ...] = (
    None,
    True,
    -1,
    0,
    10**30,
    "",
    "x" * 5000,
    "\ud800",
    "../..",
    [],
    {"a": {"b": []}},
    float("nan"),
)
PIECE = re.compile(r"[A-Za-z_][\w-]*|-?\d+(?:\.\d+)?|\"[^\"\n]*\"|[^\s\w]")


def bytes_wrong(rng: Random, data: bytes) -> bytes:
    """Flip, cut, double or insert a few bytes."""
    out = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(out) + 1)
        match rng.randrange(5):
            case 0 if at < len(out):
                out[at] = rng.randrange(256)
            case 1:
                del out[at:]
            case 2:
                out[at:at] = rng.randbytes(rng.randint(1, 8))
            case 3:
                out[at:at] = out[at : at + rng.randint(1, 64)]
            case _:
                del out[at : at + rng.randint(1, 32)]
    return bytes(out)


TYPES = ("<f4", ">f8", "<i8", "|b1", "<c16", "<U3", "|V8", "<M8[s]")
EXTREMES = (0.0, -0.0, -1.0, 1e308, -1e308, 5e-324, 2.0**62, float("nan"), float("inf"), 1e-9, 1e6)


def arrays_wrong(rng: Random, data: bytes) -> bytes:
    """Another type, shape or value of an array of an archive."""
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        arrays: dict[str, Any] = {name: file[name] for name in file.files}
    if not arrays:
        return data
    name = rng.choice(sorted(arrays))
    array = arrays[name]
    with suppress(Exception), np.errstate(all="ignore"):
        match rng.randrange(6):
            case 0:
                arrays[name] = array.astype(rng.choice(TYPES))
            case 1:
                arrays[name] = np.full_like(array, rng.choice(EXTREMES))
            case 2:
                arrays[name] = array[: rng.randrange(len(array) + 1)]
            case 3:
                arrays[name] = array.reshape(rng.choice([(-1,), (1, -1), (-1, 1), (2, -1)]))
            case 4:
                del arrays[name]
            case _:
                arrays[name] = array * rng.choice([1 + 1e-12, -1.0, 1e200])
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def tokens_wrong(rng: Random, data: bytes) -> bytes:
    """Replace, remove or double a word, a number or a line of a text."""
    text = data.decode("utf-8", errors="replace")
    for _ in range(rng.randint(1, 3)):
        pieces = list(PIECE.finditer(text))
        if not pieces or rng.random() < 0.25:
            lines = text.splitlines(keepends=True) or [""]
            at = rng.randrange(len(lines))
            lines[at : at + 1] = rng.choice(
                [[], [lines[at]] * 2, [lines[rng.randrange(len(lines))]]]
            )
            text = "".join(lines)
            continue
        piece = rng.choice(pieces)
        new = rng.choice([rng.choice(TOKENS), rng.choice(pieces).group()])
        text = text[: piece.start()] + new + text[piece.end() :]
    return text.encode("utf-8", errors="replace")


def json_wrong(rng: Random, data: bytes) -> bytes:
    """Another value, or none, somewhere in a JSON document."""
    value = json.loads(data)
    for _ in range(rng.randint(1, 3)):
        _replace(rng, value)
    return json.dumps(value).encode()


def _replace(rng: Random, value: Any) -> None:
    while True:
        keys = list(value) if isinstance(value, dict) else list(range(len(value)))
        if not keys:
            return
        key = rng.choice(keys)
        inner = value[key]
        if isinstance(inner, dict | list) and inner and rng.random() < 0.85:
            value = inner
            continue
        if rng.random() < 0.2:
            del value[key]
        else:
            value[key] = json.loads(json.dumps(rng.choice(VALUES)))
        return


def png_wrong(rng: Random, data: bytes) -> bytes:
    """A field of a chunk changed, its checksum made to fit again."""
    out, at = bytearray(data), 8
    chunks = []
    while at + 12 <= len(out):
        length = int.from_bytes(out[at : at + 4], "big")
        chunks.append((at, length))
        at += 12 + length
    at, length = rng.choice(chunks)
    if length:
        where = at + 8 + rng.randrange(min(length, 32))
        size = min(rng.choice([1, 4]), at + 8 + length - where)
        out[where : where + size] = rng.choice([b"\xff" * 4, b"\x00" * 4, rng.randbytes(4)])[:size]
    else:
        out[at + 4 : at + 8] = rng.randbytes(4)
    out[at + 8 + length : at + 12 + length] = zlib.crc32(out[at + 4 : at + 8 + length]).to_bytes(
        4, "big"
    )
    return bytes(out)


def safetensors_wrong(rng: Random, data: bytes) -> bytes:
    """The header of a weights file changed, its length made to fit again."""
    length = int.from_bytes(data[:8], "little")
    way = rng.choice([json_wrong, tokens_wrong])
    header = way(rng, data[8 : 8 + length])
    if rng.random() < 0.1:
        return rng.randbytes(8) + header + data[8 + length :]
    return len(header).to_bytes(8, "little") + header + data[8 + length :]


def mutated(rng: Random, seeds: list[bytes], ways: tuple[Mutation, ...]) -> bytes:
    """One of the seeds with something wrong; sometimes bytes that never were one."""
    if rng.random() < 0.03:
        return rng.randbytes(rng.randrange(200))
    return rng.choice(ways)(rng, rng.choice(seeds))
