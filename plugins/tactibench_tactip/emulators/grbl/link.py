"""The wire of a GRBL controller: a pseudo-terminal or a socket, with one client at a time."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import sys
import tempfile
from pathlib import Path
from typing import Protocol

from tactibench import UserError


class Link(Protocol):
    """port: for ``serial.serial_for_url``. Nothing blocks longer than ``seconds``."""

    port: str

    def wait(self, seconds: float) -> bytes:
        """What came within so many seconds; b"": nothing."""
        ...

    def connected(self) -> bool:
        """Whether a client has the port open."""
        ...

    def write(self, data: bytes) -> None:
        """Send; what no client takes is lost."""
        ...

    def close(self) -> None: ...


class PtyLink:
    """A pseudo-terminal behind a symbolic link, which stays when it is plugged in again."""

    def __init__(self, folder: Path) -> None:
        import tty  # not on Windows

        self._master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(self._master, False)
        self.folder = folder
        link = folder / "port"
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(slave))
        os.close(slave)  # from now on a hang-up says that nobody has it open
        self.port = str(link)
        self._poll = select.poll()
        self._poll.register(self._master, select.POLLIN | select.POLLHUP)

    def connected(self) -> bool:
        return not any(event & select.POLLHUP for _, event in self._poll.poll(0))

    def wait(self, seconds: float) -> bytes:
        if not self._poll.poll(seconds * 1000):
            return b""
        try:
            return os.read(self._master, 4096)
        except OSError:  # nobody has it open, or nothing came
            return b""

    def write(self, data: bytes) -> None:
        with contextlib.suppress(OSError):
            os.write(self._master, data)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            os.close(self._master)


class SocketLink:
    """A listening socket on a loopback address."""

    def __init__(self, host: str = "127.0.0.1", number: int = 0) -> None:
        self._server = socket.create_server((host, number))
        self._server.setblocking(False)
        self.number = self._server.getsockname()[1]
        self.port = f"socket://{host}:{self.number}"
        self._client: socket.socket | None = None

    def connected(self) -> bool:
        if self._client is None:
            with contextlib.suppress(BlockingIOError):
                self._client, _ = self._server.accept()
                self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return self._client is not None

    def wait(self, seconds: float) -> bytes:
        if self._client is None:
            select.select([self._server], [], [], seconds)
            return b""
        if not select.select([self._client], [], [], seconds)[0]:
            return b""
        with contextlib.suppress(OSError):
            if data := self._client.recv(4096):
                return data
        self._client.close()
        self._client = None
        return b""

    def write(self, data: bytes) -> None:
        if self._client is not None:
            with contextlib.suppress(OSError):
                self._client.sendall(data)

    def close(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None
        self._server.close()


def check_link(kind: str) -> None:
    """kind: "pty" or "socket". Raises UserError for another one, and for "pty" on Windows."""
    if kind not in {"pty", "socket"}:
        raise UserError(f"the link is {kind!r}; it must be 'pty' or 'socket'.")
    if kind == "pty" and sys.platform == "win32":
        raise UserError("Windows has no pseudo-terminals; take link 'socket'.")


def new_link(kind: str, folder: Path | None, number: int) -> PtyLink | SocketLink:
    """folder: of a pseudo-terminal's symbolic link. number: of a socket's port, 0: any free one."""
    if kind == "socket":
        return SocketLink(number=number)
    folder = folder or Path(tempfile.mkdtemp(prefix="tactibench-grbl-"))
    folder.mkdir(exist_ok=True)
    return PtyLink(folder)
