"""The UR emulator: three ports, one thread that serves them all."""

from __future__ import annotations

import contextlib
import re
import selectors
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from tactibench import UserError
from tactibench_tactip.emulators.device import Device
from tactibench_tactip.emulators.faults import Fault
from tactibench_tactip.emulators.poses import Pose6
from tactibench_tactip.emulators.ur.arm import Arm
from tactibench_tactip.emulators.ur.controller import Controller
from tactibench_tactip.emulators.ur.dashboard import GREETING, DashboardSession
from tactibench_tactip.emulators.ur.rtde import RtdeSession
from tactibench_tactip.emulators.world import World

RTDE, SCRIPT, DASHBOARD = 30004, 30003, 29999
KINDS = (
    "protective-stop",
    "unlock-refused",
    "emergency-stop",
    "socket-drop",
    "frozen-stream",
    "wrong-length",
    "program-stop",
)
TICK_S, IDLE_S = 0.002, 0.02
BACKLOG = 4 << 20
"""Bytes that a client may leave unread before it is dropped."""
SCRIPT_END = re.compile(r"(?m)^end[ \t]*\r?\n")


@dataclass(eq=False)
class _Client:
    socket: socket.socket
    port: int
    session: Any = None
    out: bytearray = field(default_factory=bytearray)
    due: float = 0.0
    text: str = ""
    last: bool = False


class UrEmulator(Device):
    """A UR controller on a loopback address of its own (ports 30004, 30003, 29999).

    tool: where the world's tool point truly is on the flange (mm, deg). tcp: what the pendant says
    of it before a client sets it; None: the same. remote: False: the pendant is in local mode.
    stop_force_n: the force at which it stops protectively; contact_force_n: at which its contact
    detection sees something. unlock_delay_s: world seconds during which an unlock is refused.
    in_use: input fields that a fieldbus holds ("input_int_register_0"). most_hz: of the data
    stream, which follows the host's clock; a real one sends up to 500.
    ``start`` raises UserError where a port is taken. A client ur_rtde must live in another process
    than the emulator, see ``apart``.
    """

    def __init__(
        self,
        world: World,
        host: str = "127.0.0.2",
        *,
        tool: Pose6 = (0.0, 0.0, 89.1, 0.0, 0.0, 0.0),
        tcp: Pose6 | None = None,
        version: tuple[int, int, int, int] = (5, 12, 2, 1101534),
        serial: str = "20225500001",
        remote: bool = True,
        stop_force_n: float = 50.0,
        contact_force_n: float = 2.0,
        unlock_delay_s: float = 5.0,
        in_use: tuple[str, ...] = (),
        most_hz: float = 500.0,
    ) -> None:
        super().__init__()
        self.world, self.host = world, host
        arm = Arm(world, tool, tool if tcp is None else tcp)
        self.controller = Controller(
            world, arm, version, remote, stop_force_n, contact_force_n, unlock_delay_s
        )
        self._serial, self._most_hz = serial, most_hz
        self._owners: dict[str, object] = dict.fromkeys(in_use, "fieldbus")
        self._servers: list[socket.socket] = []
        self._clients: list[_Client] = []
        self._frozen_until, self._wrong_by = 0.0, 0
        world.answer(KINDS, self._fault)

    # Who writes which input

    def taken(self, name: str, by: object) -> bool:
        return self._owners.get(name, by) is not by

    def take(self, name: str, by: object) -> None:
        self._owners[name] = by

    # Life

    def start(self) -> None:
        """Listen. Raises UserError where a port is taken."""
        try:
            for port in (RTDE, SCRIPT, DASHBOARD):
                self._servers.append(socket.create_server((self.host, port)))
        except OSError as error:
            self._close_servers()
            raise UserError(
                f"port {port} of {self.host} cannot be opened ({error.strerror}); another emulator "
                "may be on it: take another address, such as 127.0.0.3."
            ) from None
        self.run("ur", self._serve, list(self._servers))

    def close(self) -> None:
        """The thread closes what it serves."""

    def stop(self) -> None:
        super().stop()
        self._close_servers()

    def _close_servers(self) -> None:
        for server in self._servers:
            server.close()
        self._servers.clear()

    # The thread

    def _serve(self, servers: list[socket.socket]) -> None:
        with selectors.DefaultSelector() as selector:
            for server in servers:
                server.setblocking(False)
                selector.register(server, selectors.EVENT_READ, None)
            while not self.stopping.is_set():
                self._turn(selector)
            for client in list(self._clients):
                self._drop(selector, client)

    def _turn(self, selector: selectors.BaseSelector) -> None:
        for key, events in selector.select(self._pause()):
            if key.data is None:
                self._accept(selector, key.fileobj)
            elif events & selectors.EVENT_READ:
                self._read(selector, key.data)
        with self.world.lock:
            t = self.world.advance()
            self.controller.step(t)
            self._stream(t)
        for client in list(self._clients):
            if client.out:
                self._write(selector, client)

    def _pause(self) -> float:
        """Until the next package is due; a program is looked at every 2 ms."""
        now = time.monotonic()
        due = [c.due for c in self._clients if _streams(c)]
        wait = min(due, default=now + IDLE_S) - now
        most = TICK_S if self.controller.script is not None else IDLE_S
        return min(max(wait, 0.0), most)

    def _accept(self, selector: selectors.BaseSelector, server: Any) -> None:
        try:
            connection, _ = server.accept()
        except OSError:
            return
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client = _Client(connection, server.getsockname()[1])
        if client.port == RTDE:
            client.session = RtdeSession(self.controller, self)
        elif client.port == DASHBOARD:
            client.session = DashboardSession(self.controller, self._serial)
            client.out += GREETING
        self._clients.append(client)
        selector.register(connection, selectors.EVENT_READ, client)

    def _read(self, selector: selectors.BaseSelector, client: _Client) -> None:
        try:
            data = client.socket.recv(65536)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data or client.last:
            self._drop(selector, client)
            return
        with self.world.lock:
            t = self.world.advance()
            try:
                self._hear(client, data, t)
            except ValueError as error:
                self.controller.messages.append(f"a connection was closed: {error}")
                self._drop(selector, client)

    def _hear(self, client: _Client, data: bytes, t: float) -> None:
        if client.session is not None:
            client.out += client.session.feed(data, t)
            return
        client.text += data.decode("latin-1")
        while (end := SCRIPT_END.search(client.text)) is not None:
            text, client.text = client.text[: end.end()], client.text[end.end() :]
            self.controller.load(text, t)

    def _stream(self, t: float) -> None:
        now = time.monotonic()
        frozen = t < self._frozen_until
        for client in self._clients:
            if not _streams(client) or now < client.due:
                continue
            period = 1 / min(client.session.hertz, self._most_hz)
            client.due = max(client.due + period, now)
            if not frozen:
                client.out += client.session.sample(self._wrong_by)
                self._wrong_by = 0

    def _write(self, selector: selectors.BaseSelector, client: _Client) -> None:
        try:
            sent = client.socket.send(client.out)
        except BlockingIOError:
            sent = 0
        except OSError:
            self._drop(selector, client)
            return
        del client.out[:sent]
        if len(client.out) > BACKLOG:
            self._drop(selector, client)
        elif not client.out and getattr(client.session, "over", False):
            client.last = True
            with contextlib.suppress(OSError):
                client.socket.shutdown(socket.SHUT_WR)

    def _drop(self, selector: selectors.BaseSelector, client: _Client) -> None:
        if client not in self._clients:
            return
        self._clients.remove(client)
        with contextlib.suppress(KeyError, ValueError):
            selector.unregister(client.socket)
        client.socket.close()
        self._owners = {n: by for n, by in self._owners.items() if by is not client.session}

    # Faults

    def _fault(self, fault: Fault, t: float) -> None:
        value = fault.value
        acts: dict[str, Callable[[], None]] = {
            "protective-stop": lambda: self.controller.protective_stop(t),
            "emergency-stop": lambda: self.controller.emergency_stop(t),
            "program-stop": lambda: self.controller.end_program(t),
            "socket-drop": self._hang_up,
        }
        if fault.kind in acts:
            acts[fault.kind]()
        elif fault.kind == "unlock-refused":
            self.controller.refusals += int(3 if value is None else value)
        elif fault.kind == "frozen-stream":
            self._frozen_until = t + (float("inf") if value is None else value)
        else:
            self._wrong_by = int(7 if value is None else value)

    def _hang_up(self) -> None:
        """The thread sees the end and drops them."""
        for client in self._clients:
            if client.port != DASHBOARD:
                with contextlib.suppress(OSError):
                    client.socket.shutdown(socket.SHUT_RDWR)


def _streams(client: _Client) -> bool:
    return client.port == RTDE and client.session.streaming
