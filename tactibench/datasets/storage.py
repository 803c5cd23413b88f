"""Files and folders that survive a crash, and the lock of a folder that is written.

A file survives a crash when its content and the folder that names it were synced.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from uuid import uuid4

from tactibench.errors import UserError
from tactibench.records import atomic


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


def sync_file(path: Path) -> None:
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
    """Yield a temporary folder beside ``target``, which takes its name when the block succeeds.

    Args:
        target: The folder to make.
        source: Folder of the data set, into which nothing may be written.

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
        UserError: A file or folder has the name already, or the folder above is missing.
    """
    _refuse_missing_parent(path)
    if path.exists() or path.is_symlink():
        raise UserError(f"{path} is there already; move it away first, nothing is overwritten.")
    with atomic(path) as stream:
        stream.write(text.encode())


def _refuse_missing_parent(target: Path) -> None:
    if not target.parent.is_dir():
        raise UserError(f"the folder {target.parent} is not there; make it first.")


class WriterLock:
    """The right to write a folder, which one writer has at a time.

    A file beside the lock names its owner, so that the next writer can say who is at work.

    Args:
        path: The lock's file, inside the folder that is written.

    Raises:
        UserError: Another writer holds the lock; the sentence names it.
        OSError: The lock's file cannot be made.
    """

    def __init__(self, path: Path) -> None:
        from filelock import FileLock, Timeout  # takes a tenth of a second to import

        self._path = path
        self._owner_file = path.with_name(f"{path.name}.owner")
        self._lock = FileLock(path)
        try:
            self._lock.acquire(timeout=0)
        except Timeout:
            raise UserError(self._busy(self._owner())) from None
        owner = self._owner()
        # A network disk may not show this machine the locks of another one: then the name decides.
        if owner.get("host", socket.gethostname()) != socket.gethostname():
            self._lock.release()
            raise UserError(self._busy(owner))
        self._owner_file.write_text(json.dumps({"pid": os.getpid(), "host": socket.gethostname()}))

    def release(self) -> None:
        """Release the lock, so that another writer can take it. A second call does nothing."""
        if self._lock.is_locked:
            self._owner_file.unlink(missing_ok=True)
            if os.name == "posix":  # while it is held: whoever waits finds the file gone
                self._path.unlink(missing_ok=True)
            self._lock.release()

    def _owner(self) -> dict[str, Any]:
        try:
            owner = json.loads(self._owner_file.read_bytes())
        except (OSError, ValueError):
            return {}
        return owner if isinstance(owner, dict) else {}

    def _busy(self, owner: dict[str, Any]) -> str:
        writer = "another process"
        if owner:
            writer = f"process {owner.get('pid', '?')} on {owner.get('host', 'this machine')}"
        advice = "wait for it or end it"
        if owner.get("host", socket.gethostname()) != socket.gethostname():
            advice = f"when it has ended, delete {self._owner_file}"
        return f"{self._path.parent} is being written by {writer}; {advice}."
