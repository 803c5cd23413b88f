"""Texts of records, answers and archives as somebody would forge them; see ``forged``."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from forged import Arrays, forge_archive, forge_arrays, forge_bytes, forge_text

TEXTS: dict[str, Callable[[str], str]] = {
    "a key twice": lambda text: text.replace('"partial"', '"partial": true, "partial"', 1),
    "deep": lambda text: "[" * 50_000,
    "deep inside": lambda text: text.replace(
        '"notes": {', '"notes": {"a": ' + "[" * 900 + "]" * 900 + ", ", 1
    ),
    "huge number": lambda text: text.replace('"rejected": ', '"rejected": 9' + "0" * 4000, 1),
    "huge exponent": lambda text: text.replace('"seconds": ', '"seconds": 1e308, "x": ', 1),
    "lone surrogate": lambda text: text.replace('"cpu": "', '"cpu": "\\ud800', 1),
    "control": lambda text: text.replace('"cpu": "', '"cpu": "\\u001b[2J', 1),
    "right to left": lambda text: text.replace('"cpu": "', '"cpu": "\\u202e', 1),
    "byte order mark": lambda text: "\ufeff" + text,
    "a key twice, once escaped": lambda text: text.replace(
        '"partial"', '"\\u0070artial": true, "partial"', 1
    ),
    "a key twice inside": lambda text: text.replace('"cpu": ', '"cpu": "Cray", "cpu": ', 1),
    "two values": lambda text: text + text,
    "a NUL behind": lambda text: text + "\0",
    "many keys": lambda text: text.replace(
        '"notes": {', '"notes": {' + ",".join(f'"k{k}":{k}' for k in range(40_000)) + ", ", 1
    ),
}


def _set(name: str, change: Callable[[Any], Any]) -> Callable[[Arrays], Arrays]:
    return lambda arrays: {**arrays, name: change(arrays[name])}


def _filled(value: float) -> Callable[[Any], Any]:
    return lambda array: np.full_like(array, value)


def _no_characters(texts: Any) -> Any:
    """Texts with a number beyond the last character of Unicode."""
    numbers = texts.view(np.uint32).copy()
    numbers[0] = 0x110000
    return numbers.view(texts.dtype)


def _bools(array: Any) -> Any:
    """Truth values whose bytes are neither 0 nor 1: their sum is anything."""
    return np.full(len(array), 7, np.uint8).view(bool)


ARRAYS: dict[str, Callable[[Arrays], Arrays]] = {
    "single precision": _set("xy", lambda a: a.astype(np.float32)),
    "long double": _set("xy", lambda a: a.astype(np.longdouble)),
    "half precision": _set("depth", lambda a: a.astype(np.float16)),
    "other byte order": _set("depth", lambda a: a.astype(">f8")),
    "structured": _set("depth", lambda a: np.zeros(len(a), dtype=[("a", "<f8"), ("b", "<i4")])),
    "empty items": _set("depth", lambda a: np.zeros(len(a), dtype="S0")),
    "void": _set("depth", lambda a: np.zeros(len(a), dtype="V7")),
    "times": _set("depth", lambda a: a.astype("datetime64[s]")),
    "no axis": _set("depth", lambda _: np.float64(1.0)),
    "32 axes": _set("depth", lambda a: a.reshape(-1, *[1] * 31)),
    "unsigned": _set("count", lambda a: a.astype(np.uint64)),
    "huge": _set("xy", _filled(1e308)),
    "far away": _set("xy", _filled(1e9)),
    "deep": _set("depth", _filled(-1e308)),
    "subnormal spread": _set("std", _filled(5e-324)),
    "no spread": _set("std", _filled(0.0)),
    "negative spread": _set("std", _filled(-1.0)),
    "huge spread": _set("std", _filled(1e300)),
    "counts that wrap": _set("count", _filled(2**62)),
    "ranked words": _set("ranked.press", lambda a: a.astype("U5000")),
    "ranked none": lambda arrays: {n: a for n, a in arrays.items() if not n.startswith("ranked")},
    "ranked more": lambda arrays: {**arrays, "ranked.more": np.zeros(3)},
    "ranked huge": _set("ranked.error", _filled(1e308)),
    "ranked no characters": _set("ranked.press", _no_characters),
    "a bool of another byte": lambda arrays: {**arrays, "given": _bools(arrays["count"])},
    "a path": lambda arrays: {**arrays, "../../evil": np.zeros(1)},
}


def _array(header: str, body: bytes = b"", version: bytes = b"\x01\x00") -> bytes:
    text = header.encode("latin-1")
    size = len(text).to_bytes(2 if version[0] == 1 else 4, "little")
    return b"\x93NUMPY" + version + size + text + body


def _with(name: str, data: bytes) -> Callable[[zipfile.ZipFile, dict[str, bytes]], None]:
    def write(archive: zipfile.ZipFile, members: dict[str, bytes]) -> None:
        for member, body in {**members, name: data}.items():
            archive.writestr(member, body)

    return write


def _tiny_arrays(archive: zipfile.ZipFile, members: dict[str, bytes]) -> None:
    stream = io.BytesIO()
    np.save(stream, np.zeros(1))
    for name, body in members.items():
        archive.writestr(name, body)
    for number in range(100_000):
        archive.writestr(zipfile.ZipInfo(f"{number}.npy"), stream.getvalue())


def _twice(archive: zipfile.ZipFile, members: dict[str, bytes]) -> None:
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, body in [*members.items(), *members.items()]:
            archive.writestr(name, body)


def _packed(method: int) -> Callable[[zipfile.ZipFile, dict[str, bytes]], None]:
    def write(archive: zipfile.ZipFile, members: dict[str, bytes]) -> None:
        for name, body in members.items():
            archive.writestr(name, body, method)

    return write


ARCHIVES: dict[str, Callable[[zipfile.ZipFile, dict[str, bytes]], None]] = {
    "100,000 tiny arrays": _tiny_arrays,
    "members twice": _twice,
    "deep header": _with("depth.npy", _array("(" * 9000)),
    "deep long header": _with("depth.npy", _array("[" * 60_000, version=b"\x02\x00")),
    "header of nulls": _with("depth.npy", _array("\0" * 100)),
    "header of operators": _with("depth.npy", _array("-" * 9000 + "1")),
    "header without type": _with("depth.npy", _array("{'shape': (3,)}\n")),
    "strange type": _with(
        "depth.npy",
        _array(
            "{'descr': [('a', [('b', '<f8')], (9, 9))], 'fortran_order': False, 'shape': (3,)}\n"
        ),
    ),
    "huge type": _with(
        "depth.npy", _array("{'descr': '<U2147483647', 'fortran_order': False, 'shape': ()}\n")
    ),
    "objects": _with(
        "depth.npy",
        _array(
            "{'descr': '|O', 'fortran_order': False, 'shape': (1,)}\n", b"cos\nsystem\n(S'id'\ntR."
        ),
    ),
    "negative shape": _with(
        "depth.npy", _array("{'descr': '<f8', 'fortran_order': False, 'shape': (-1,)}\n")
    ),
    "shape that wraps": _with(
        "depth.npy",
        _array("{'descr': '<f8', 'fortran_order': False, 'shape': (4294967296, 4294967296, 0)}\n"),
    ),
    "true shape": _with(
        "depth.npy",
        _array("{'descr': '<f8', 'fortran_order': False, 'shape': (True,)}\n", bytes(8)),
    ),
    "no array": _with("depth.npy", b"x"),
    "capitals": _with(
        "DEPTH.npy", _array("{'descr': '<f8', 'fortran_order': False, 'shape': (0,)}\n")
    ),
    "a folder": _with("depth.npy/", b""),
    "a NUL in a name": _with("depth.npy\0.npy", b""),
    "lzma": _packed(zipfile.ZIP_LZMA),
    "bzip2": _packed(zipfile.ZIP_BZIP2),
    "a script": _with("run.py", b"print(1)"),
}


def _ahead(data: bytes) -> bytes:
    return b"<!doctype html><script>alert(1)</script>" + data


def _encrypted(data: bytes) -> bytes:
    """Every member says that it is encrypted."""
    local, central = b"PK\x03\x04", b"PK\x01\x02"
    changed = bytearray(data)
    for sign, place in ((local, 6), (central, 8)):
        at = data.find(sign)
        while at >= 0:
            changed[at + place] |= 1
            at = data.find(sign, at + 4)
    return bytes(changed)


def _another_size(count: int) -> Callable[[bytes], bytes]:
    """The directory says another unpacked size of every member."""

    def change(data: bytes) -> bytes:
        changed = bytearray(data)
        at = data.find(b"PK\x01\x02")
        while at >= 0:
            changed[at + 24 : at + 28] = count.to_bytes(4, "little")
            at = data.find(b"PK\x01\x02", at + 4)
        return bytes(changed)

    return change


def _comment(data: bytes) -> bytes:
    """An archive with a comment as long as one may be."""
    assert data[-2:] == b"\0\0"
    return data[:-2] + (65535).to_bytes(2, "little") + b"c" * 65535


BYTES: dict[str, Callable[[bytes], bytes]] = {
    "a page ahead": _ahead,
    "encrypted": _encrypted,
    "no bytes": _another_size(0),
    "fewer bytes": _another_size(200),
    "more bytes": _another_size(2**20),
    "4 GiB": _another_size(2**32 - 2),
    "a comment": _comment,
    "nothing": lambda _: b"",
    "half": lambda data: data[: len(data) // 2],
    "much behind": lambda data: data + bytes(100_000),
}
"""The bytes of an archive."""


FILES: dict[str, Callable[[Path], Path]] = {
    f"{kind} {name}": partial(forge, change)
    for kind, forge, changes in (
        ("text:", forge_text, TEXTS),
        ("answers:", forge_arrays, ARRAYS),
        ("archive:", forge_archive, ARCHIVES),
        ("bytes:", forge_bytes, BYTES),
    )
    for name, change in changes.items()
}
"""Name of a forgery -> writes it into a folder and returns the path of its record."""
