"""Files and folders that are written whole or not at all, and the cache that holds them."""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from tactibench.errors import UserError
from tactibench.records.identity import canonical, digest

VARIABLE = "TACTIBENCH_CACHE"
MANIFEST = "manifest.json"


def cache_folder() -> Path:
    """Return ``TACTIBENCH_CACHE``, or the platform's user cache: files that can be made again."""
    given = os.environ.get(VARIABLE)
    if given:
        return Path(given).expanduser()
    import platformdirs

    return Path(platformdirs.user_cache_dir("tactibench", appauthor=False))


@contextmanager
def atomic(path: Path) -> Iterator[IO[bytes]]:
    """Open a temporary file beside ``path`` for writing; it takes the name when all went well.

    A ``path`` that is no plain file, such as ``/dev/stdout`` or a pipe, is written to directly and
    stays what it is.
    """
    if path.exists() and not path.is_file():
        with path.open("wb") as stream:
            yield stream
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        Path(name).chmod(0o644)
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def write_json(path: Path, value: Any) -> None:
    """Write readable JSON.

    Raises:
        ValueError: A number is NaN or infinite, which has no meaning in JSON.
    """
    text = json.dumps(value, indent=1, sort_keys=False, allow_nan=False, ensure_ascii=False)
    with atomic(path) as stream:
        stream.write(text.encode() + b"\n")


def parse_json(text: str) -> Any:
    """Return the value of a JSON text whose numbers are all finite, as ``write_json`` writes them.

    Raises:
        ValueError: The text is no JSON, holds a number that is not finite (NaN, or 1e999, which is
            too large), or holds a key twice: a reader would see one value, and a program another.
        RecursionError: Lists or objects are too deep inside each other.
    """
    # Only such a number can be too large; elsewhere the parser's own conversion is faster.
    check = _finite if HUGE.search(text) else None
    return json.loads(text, parse_constant=_finite, parse_float=check, object_pairs_hook=_unique)


CHECKSUM = "checksum"
HUGE = re.compile(r"[eE]\+?0*[1-9]\d\d|\d{290}")
"""Numbers that may be too large for a float: an exponent of three digits, or 290 digits."""


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"it holds the key {twice[:40]!r} twice")
    return values


def _finite(word: str) -> float:
    value = float(word)
    if not math.isfinite(value):
        raise ValueError(f"it holds {word[:40]}, which is no finite number")
    return value


def read_json(path: Path) -> Any:
    """Read JSON.

    Raises:
        UserError: The file is missing or damaged.
    """
    try:
        return parse_json(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise UserError(f"{path} does not exist.") from None
    except (ValueError, RecursionError, OSError) as error:
        raise UserError(f"{path} cannot be read as JSON: {error}.") from None


def write_checked_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write a JSON object with a checksum of everything in it."""
    write_json(path, {**values, CHECKSUM: digest(dict(values))})


def read_checked_json(path: Path) -> dict[str, Any]:
    """Return the object of ``write_checked_json``.

    Raises:
        UserError: The file is missing or damaged, or its values are not those that were written.
    """
    values = read_json(path)
    if not isinstance(values, dict):
        raise UserError(f"{path} holds no JSON object; restore it.")
    if values.pop(CHECKSUM, None) != digest(values):
        raise UserError(f"{path} is not what was written; delete it, or restore it.")
    return values


def write_arrays(path: Path, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
    """Write named arrays, compressed."""
    with atomic(path) as stream:
        np.savez_compressed(stream, allow_pickle=False, **arrays)


def read_arrays(path: Path) -> dict[str, npt.NDArray[Any]]:
    """Read named arrays.

    Raises:
        UserError: The file is missing or damaged.
    """
    try:
        # np.load leaves a file that is no archive open.
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise UserError(f"{path} does not exist.") from None
    except Exception as error:  # noqa: BLE001 - zip, zlib, header and value errors alike
        problem = f"{path} is damaged ({type(error).__name__})"
        raise UserError(f"{problem}; delete it and run again.") from None


def write_checked_arrays(
    path: Path, arrays: Mapping[str, npt.NDArray[Any]], *, compress: bool = True
) -> None:
    """Write named arrays with a checksum over them.

    Args:
        path: File to write.
        arrays: Arrays by name.
        compress: Whether the file is compressed.
    """
    checksum = np.array(arrays_hash(arrays))
    write = np.savez_compressed if compress else np.savez
    with atomic(path) as stream:
        write(stream, allow_pickle=False, **arrays, checksum=checksum)


def read_checked_arrays(path: Path) -> dict[str, npt.NDArray[Any]] | None:
    """Return the arrays of ``write_checked_arrays``; None where the file is missing or damaged."""
    try:
        arrays = read_arrays(path)
        checksum = str(arrays.pop("checksum"))
    except (UserError, KeyError):
        return None
    return arrays if checksum == arrays_hash(arrays) else None


def arrays_hash(arrays: Mapping[str, npt.NDArray[Any]]) -> str:
    """Return sha256 over names, types, shapes and values; the file format does not matter."""
    total = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        total.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        total.update(array.view(np.uint8).reshape(-1).data if array.size else b"")
    return total.hexdigest()


def file_hash(path: Path) -> str:
    """Return sha256 of a file's bytes."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold a lock, so that two processes do not make the same thing at once.

    Waits until the lock is free; a thread that holds it may take it again.

    Args:
        path: The lock's file; its folder is made if it is missing.
    """
    from filelock import FileLock  # takes a tenth of a second to import

    path.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(path, poll_interval=0.02, is_singleton=True):
        yield


def beside(folder: Path, suffix: str) -> Path:
    """Return the hidden path beside a folder that ends in ``suffix``, such as ".lock"."""
    return folder.with_name(f".{folder.name}{suffix}")


def replace_folder(made: Path, folder: Path) -> None:
    """Give a folder that is whole its name; another one of that name is removed."""
    old = beside(folder, ".old")
    shutil.rmtree(old, ignore_errors=True)
    if folder.exists():
        folder.rename(old)
    made.rename(folder)
    shutil.rmtree(old, ignore_errors=True)


@dataclass(frozen=True)
class CacheEntry:
    """A folder of files that can be made again: it is whole, or it is not there.

    A manifest holds the identity of the entry and the hash of every file. Whoever reads or writes
    an entry holds its lock.

    Attributes:
        folder: Folder of the entry.
        identity: Everything that the files are made from, as a JSON value.
    """

    folder: Path
    identity: Any

    @property
    def cached(self) -> bool:
        """Return whether the entry is there; it is verified when it is read."""
        return (self.folder / MANIFEST).is_file()

    def locked(self) -> AbstractContextManager[None]:
        """Return the lock of the entry: two processes that make one entry take turns."""
        return locked(beside(self.folder, ".lock"))

    def read(self) -> dict[str, Any] | None:
        """Return the manifest, with the hash of every file by name as ``files``.

        None where the entry is missing, a file was changed, or it was made from something else.
        """
        try:
            manifest = read_checked_json(self.folder / MANIFEST)
            intact = canonical(manifest["identity"]) == canonical(self.identity) and all(
                file_hash(self.folder / name) == value for name, value in manifest["files"].items()
            )
        except (UserError, OSError, KeyError, TypeError, AttributeError, ValueError):
            return None
        return manifest if intact else None

    def write(self, fill: Callable[[Path], Mapping[str, Any]]) -> dict[str, Any]:
        """Write the entry, and return its manifest. What was there before is replaced.

        Args:
            fill: Function that writes all files into an empty folder, and returns further values
                of the manifest.
        """
        made = beside(self.folder, ".made")
        shutil.rmtree(made, ignore_errors=True)
        made.mkdir(parents=True)
        try:
            facts = fill(made)
            paths = sorted(path for path in made.rglob("*") if path.is_file())
            files = {path.relative_to(made).as_posix(): file_hash(path) for path in paths}
            manifest = {"identity": self.identity, "files": files, **facts}
            write_checked_json(made / MANIFEST, manifest)
            replace_folder(made, self.folder)
        finally:
            shutil.rmtree(made, ignore_errors=True)
        return manifest

    def remove(self) -> None:
        """Remove the entry, so that it is made anew."""
        with self.locked():
            shutil.rmtree(self.folder, ignore_errors=True)
