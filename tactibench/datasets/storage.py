"""Files and folders that survive a crash: what counts is what the disk has, names included.

A file is there after a crash when its content and the folder that names it were synced.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from tactibench.errors import UserError
from tactibench.records.files import atomic


def sync_folder(folder: Path) -> None:
    """Wait until the disk has the names in a folder, where the system can open folders."""
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


def write_unsynced(path: Path | str, data: bytes) -> None:
    """Write a file under a temporary name that nobody reads; an error leaves nothing of it."""
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


@contextmanager
def new_folder(target: Path, source: Path) -> Iterator[Path]:
    """Give a temporary neighbour of ``target``, which takes its name when all went well.

    Args:
        target: The folder to make.
        source: Folder of the data set, which nothing may be written into.

    Raises:
        UserError: ``target`` is a file, holds something, lies in ``source``, or has no parent.
    """
    target = target.absolute()
    _refuse_missing_parent(target)
    if target.resolve().is_relative_to(source.resolve()):
        raise UserError(f"{target} lies in the data set {source}; give a folder outside of it.")
    if target.is_symlink() or (target.exists() and not target.is_dir()):
        raise UserError(f"{target} is a file or a link; give the name of a new folder.")
    if target.is_dir() and any(target.iterdir()):
        raise UserError(
            f"{target} holds files already; give the name of a new folder, nothing is overwritten."
        )
    temporary = target.with_name(f".{target.name}.{uuid4().hex[:8]}")
    temporary.mkdir()
    try:
        yield temporary
        if target.is_dir():  # empty; a folder takes the place of an empty one on POSIX only
            target.rmdir()
        temporary.rename(target)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise


def write_new_text(path: Path, text: str) -> None:
    """Write a text file under a free name.

    Raises:
        UserError: Something has the name already, or the folder is missing.
    """
    _refuse_missing_parent(path)
    if path.exists() or path.is_symlink():
        raise UserError(f"{path} is there already; move it away first, nothing is overwritten.")
    with atomic(path) as stream:
        stream.write(text.encode())


def _refuse_missing_parent(target: Path) -> None:
    if not target.parent.is_dir():
        raise UserError(f"the folder {target.parent} is not there; make it first.")
