"""Files to which lines are only ever added: one write a line, so that a crash tears the last one.

POSIX: a write to a file opened with O_APPEND goes to its end as one piece; fsync returns when the
disk has it.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from tactibench.datasets.v1.rows import is_json
from tactibench.errors import UserError


@dataclass(frozen=True)
class Lines:
    """whole: the lines, without their ends. size: bytes of them on the disk. torn: what stands
    behind them, the piece of a line whose writing was interrupted."""

    whole: tuple[bytes, ...]
    size: int
    torn: bytes


def read_lines(path: Path) -> Lines:
    """The lines of a journal; a file that is not there has none.

    A last line that has no end or is no JSON was never acknowledged. Raises UserError when the file
    cannot be read.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        data = b""
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror or error}.") from None
    *lines, _ = data.split(b"\n")
    if lines and not is_json(lines[-1]):
        lines.pop()
    size = sum(len(line) + 1 for line in lines)
    return Lines(tuple(lines), size, data[size:])


class Journal:
    """The writing end of a journal. fsync: wait for the disk after each ``append``."""

    def __init__(self, path: Path, *, fsync: bool = True) -> None:
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | getattr(os, "O_BINARY", 0)
        self._file: int | None = os.open(path, flags, 0o644)
        self._path = path
        self._fsync = fsync

    def append(self, lines: Iterable[bytes]) -> None:
        """Add lines, each in one write, then wait for the disk once.

        Raises OSError; what was written of the lines is taken back.
        """
        assert self._file is not None, "the journal is closed"  # noqa: S101
        before = os.fstat(self._file).st_size
        try:
            for line in lines:
                if os.write(self._file, line) != len(line):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._path))
            if self._fsync:
                os.fsync(self._file)
        except OSError:
            os.ftruncate(self._file, before)
            raise

    def sync(self) -> None:
        """Wait for the disk."""
        if self._file is not None:
            os.fsync(self._file)

    def close(self) -> None:
        if self._file is not None:
            os.close(self._file)
            self._file = None


def cut(path: Path, size: int) -> None:
    """Shorten a journal to its whole lines, and wait for the disk."""
    with path.open("r+b") as stream:
        stream.truncate(size)
        os.fsync(stream.fileno())
