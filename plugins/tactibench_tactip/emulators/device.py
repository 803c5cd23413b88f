"""A device of the emulators, and the faults that it can have."""

from __future__ import annotations

import math
import select
import socket
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from threading import Event, Thread
from types import MappingProxyType
from typing import Self

from tactibench import UserError

DEADLINE_S = 5.0
"""Host seconds within which a thread of a stopped device must end."""
IDLE_S = 0.02
"""Host seconds between two checks whether to stop."""
Talk = Callable[[socket.socket], None]
"""A function that serves one connection until it ends; OSError and ValueError end it, too."""


class Device(ABC):
    """A device that serves sockets; ``start`` and ``stop`` may be called repeatedly."""

    def __init__(self) -> None:
        self.stopping = Event()
        self._threads: list[Thread] = []
        self._servers: list[socket.socket] = []
        self._clients: dict[socket.socket, int] = {}

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @abstractmethod
    def start(self) -> None:
        """Open the device."""

    def stop(self) -> None:
        """Close the device and join its threads.

        Raises:
            RuntimeError: A thread does not end within DEADLINE_S.
        """
        self.stopping.set()
        self.close()
        for thread in self._threads:
            thread.join(DEADLINE_S)
        left = [thread.name for thread in self._threads if thread.is_alive()]
        self._threads.clear()
        self.stopping.clear()
        if left:
            raise RuntimeError(f"threads did not end within {DEADLINE_S:g} s: {', '.join(left)}")

    def close(self) -> None:
        """Close every server and connection, so that their threads end."""
        for server in self._servers:
            server.close()
        self._servers.clear()
        self.hang_up()

    def run(self, name: str, target: Callable[..., None], *arguments: object) -> None:
        """Run ``target`` with its arguments on a thread of the device."""
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        thread = Thread(target=target, args=arguments, name=name, daemon=True)
        self._threads.append(thread)
        thread.start()

    def listen(self, host: str, port: int, talk: Talk) -> int:
        """Serve each connection to a port on its own thread, and return the port's number.

        Args:
            host: Address to listen on.
            port: Number of the port; 0 takes any free one.
            talk: Function that serves one connection.

        Raises:
            OSError: The port cannot be opened, for instance because it is taken.
        """
        server = socket.create_server((host, port))
        self._servers.append(server)
        number: int = server.getsockname()[1]
        self.run(f"port {number}", self._accept, server, number, talk)
        return number

    def hang_up(self, *ports: int) -> None:
        """Shut down the connections to these ports, or all without a port; their threads end."""
        for client, port in list(self._clients.items()):
            if not ports or port in ports:
                with suppress(OSError):
                    client.shutdown(socket.SHUT_RDWR)

    def received(self, client: socket.socket) -> Iterator[bytes]:
        """Yield what a client sends until it closes the connection."""
        while not self.stopping.is_set():
            if select.select([client], [], [], IDLE_S)[0]:
                data = client.recv(65536)
                if not data:
                    return
                yield data

    def _accept(self, server: socket.socket, port: int, talk: Talk) -> None:
        while server.fileno() >= 0 and not self.stopping.is_set():
            with suppress(OSError, ValueError):  # it was closed meanwhile
                if select.select([server], [], [], IDLE_S)[0]:
                    client, _ = server.accept()
                    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self._clients[client] = port
                    self.run(f"client of port {port}", self._serve, client, talk)

    def _serve(self, client: socket.socket, talk: Talk) -> None:
        try:
            with client, suppress(OSError, ValueError):
                talk(client)
        finally:
            self._clients.pop(client, None)


FAULTS = MappingProxyType(
    {
        # UR
        "protective-stop": "the controller stops the arm; unlock after the delay",
        "unlock-refused": "the next ``value`` unlocks are refused, whatever the delay (default 3)",
        "emergency-stop": "the emergency button is pressed; nothing unlocks it",
        "socket-drop": "the controller closes every RTDE and script connection",
        "frozen-stream": "the controller sends no data package for ``value`` s (default: for ever)",
        "wrong-length": "the next data package's header gives a wrong length",
        "program-stop": "the control script ends",
        # GRBL
        "alarm-1": "hard limit: motion stops at once, position lost",
        "alarm-2": "soft limit: motion stops, position kept",
        "alarm-3": "reset while moving: position lost, banner",
        "alarm-5": "the next ``value`` probes meet nothing, wherever the surface is (default 1)",
        "no-ok": "the next ``value`` lines get no answer (default 1)",
        "garbled-line": "the next answer is damaged on its way",
        "unplug": "the port goes away until it is plugged in again",
        "hold": "feed hold, as somebody at the machine presses it",
        # Camera
        "camera-stall": "no frame for ``value`` s (default: for ever); the connection stays",
        "camera-drop": "the connection closes; a new one is served",
        "stale-frames": "for ``value`` s (default 2) the frame of the moment it began is repeated",
        "black-frames": "for ``value`` s (default 2) frames are black",
        "brightness-jump": "from now on frames are ``value`` grey levels brighter (default 40)",
        "pin-loss": "from now on ``value`` pins are missing (default 5)",
    }
)
"""Name -> effect; seconds are of the world's clock. A full disk is no fault of a device: the tests
of a collection cover it."""
DEFAULTS = MappingProxyType(
    {
        "unlock-refused": 3.0,
        "frozen-stream": math.inf,
        "wrong-length": 7.0,
        "alarm-5": 1.0,
        "no-ok": 1.0,
        "camera-stall": math.inf,
        "stale-frames": 2.0,
        "black-frames": 2.0,
        "brightness-jump": 40.0,
        "pin-loss": 5.0,
    }
)
"""Fault -> its value where none is given, for the faults that have a value."""


@dataclass(frozen=True)
class Fault:
    """A fault that happens during a press, or at once.

    Attributes:
        kind: Name of the fault, a key of FAULTS.
        press: Number of the press at which it happens, from 1; None: at once.
        depth_mm: Depth at which it happens on the way down. A shallower press does not trigger it.
            Every press of the protocols reaches the default depth.
        value: Value of the fault, see FAULTS; None: that of DEFAULTS.

    Raises:
        UserError: There is no such fault, its press is below 1, or its depth at a press is not
            above 0 mm.
    """

    kind: str
    press: int | None = None
    depth_mm: float = 0.45
    value: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in FAULTS:
            raise UserError(f"there is no fault {self.kind!r}; known are {', '.join(FAULTS)}.")
        if self.press is not None and (self.press < 1 or not self.depth_mm > 0):
            raise UserError(
                f"fault {self.kind!r} at press {self.press}, {self.depth_mm:g} mm deep; presses "
                "count from 1 and the depth must be above 0 mm."
            )

    @property
    def amount(self) -> float:
        """The value, or its default."""
        return DEFAULTS[self.kind] if self.value is None else self.value


@dataclass(frozen=True)
class FaultEvent:
    """A fault that happened.

    Attributes:
        fault: The fault.
        at_s: Time of the world, s.
        press: Number of the latest press that had begun; 0 before the first.
        handled: Whether a device of this world acts on it.
    """

    fault: Fault
    at_s: float
    press: int
    handled: bool
