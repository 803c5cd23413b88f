"""Making names on a disk last: a file is there after a crash when its folder is synced, too."""

from __future__ import annotations

import os
from pathlib import Path


def sync_folder(folder: Path) -> None:
    """Wait until the disk has the names in a folder (where the system can open folders)."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:  # Windows: names are durable with the file
        return
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def make_folder(folder: Path) -> None:
    """Make a folder and those above it, each name durable."""
    if folder.is_dir():
        return
    make_folder(folder.parent)
    folder.mkdir(exist_ok=True)
    sync_folder(folder.parent)


def write_new(path: Path | str, data: bytes) -> None:
    """Write a file under a temporary name that nobody reads; nothing is left of it on an error."""
    try:
        with open(path, "wb", buffering=0) as stream:  # noqa: PTH123 - a path may be plain text
            written = 0
            while written < len(data):
                written += stream.write(data[written:])
    except BaseException:
        Path(path).unlink(missing_ok=True)
        raise


def sync_file(path: Path | str) -> None:
    """Wait until the disk has the content of a file."""
    handle = os.open(path, os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def sync_all() -> None:
    """Wait until the disk has everything that was written so far."""
    if hasattr(os, "sync"):
        os.sync()
