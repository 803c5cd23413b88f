"""The lock of a data set; the operating system frees it when the process that holds it ends."""

from __future__ import annotations

import json
import os
import socket
from pathlib import Path
from typing import Any

from tactibench.errors import UserError


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
        """Let another writer in. A second call does nothing."""
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
