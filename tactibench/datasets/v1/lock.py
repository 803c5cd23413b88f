"""One writer at a time: a lock that names its owner and does not outlive it.

The system's file lock falls with the process that holds it; the text in the file tells the other
one who that is. Where a file system knows no locks, the text alone decides.
"""

from __future__ import annotations

import errno
import json
import os
import socket
from pathlib import Path
from typing import Any

from tactibench.errors import UserError

_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL}


class Lock:
    """Held from the call until ``release``. Raises UserError, which names the owner, when another
    process or another writer of this one holds it."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = _take(path)
        os.ftruncate(self._file, 0)
        owner = {"pid": os.getpid(), "host": socket.gethostname(), "start": start_of(os.getpid())}
        os.lseek(self._file, 0, os.SEEK_SET)
        os.write(self._file, json.dumps(owner).encode())

    def release(self) -> None:
        """Let another writer in. Nothing happens the second time."""
        if self._file >= 0:
            self._path.unlink(missing_ok=True)  # before the lock falls: whoever waits looks again
            os.close(self._file)
            self._file = -1


def start_of(pid: int) -> str:
    """When a process began, so that its number is not taken for it; "": it is not there, or this
    system does not say."""
    try:
        # proc(5): field 22, counted behind the name, which may hold spaces and brackets.
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[19]
    except (OSError, IndexError):
        return ""


def _take(path: Path) -> int:
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            locked = _flock(file)
            owner = _owner(path)
            if locked is False or _lives(owner, locked is True):
                raise UserError(_busy(path, owner))
            if _same(file, path):
                return file
        except BaseException:
            os.close(file)
            raise
        os.close(file)  # released, and so removed, between our opening and locking it


def _flock(file: int) -> bool | None:
    """Whether the lock was free; None where there are no such locks."""
    try:
        import fcntl
    except ImportError:
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in _NO_LOCKS:
            return None
        return False
    return True


def _lives(owner: dict[str, Any], locked: bool) -> bool:
    """Whether the owner whom the file names may still write, though the lock was free."""
    if not owner:
        return False
    if owner.get("host") != socket.gethostname():
        return True  # nobody can tell from here
    if locked or owner.get("pid") == os.getpid():
        return not locked
    start = start_of(int(owner.get("pid", 0)))
    return start != "" and start == owner.get("start")


def _owner(path: Path) -> dict[str, Any]:
    try:
        owner = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return {}
    return owner if isinstance(owner, dict) else {}


def _same(file: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file), path.stat())
    except FileNotFoundError:
        return False


def _busy(path: Path, owner: dict[str, Any]) -> str:
    here = owner.get("host") == socket.gethostname()
    who = f"process {owner.get('pid', '?')} on {owner.get('host', 'this machine')}"
    what = "wait for it or end it" if here or not owner else f"when it has ended, delete {path}"
    return f"{path.parent} is being written by {who}; {what}."
