"""A GRBL controller behind a socket."""

from __future__ import annotations

import contextlib
import select
import socket
from collections.abc import Mapping

from tactibench_tactip.emulators.device import Device, Fault
from tactibench_tactip.emulators.grbl_firmware import Controller
from tactibench_tactip.emulators.world import World

KINDS = ("alarm-1", "alarm-2", "alarm-3", "alarm-5", "no-ok", "garbled-line", "unplug", "hold")
BUSY_S, IDLE_S, BOOT_S = 0.004, 0.02, 0.1
"""Host seconds: between looks at the clock while it moves and while it does not, and from opening
the port to the banner (a real Arduino takes up to 2 s)."""


class GrblEmulator(Device):
    """A GRBL controller behind a socket; ``port`` is for ``serial.serial_for_url``.

    settings: {"$20": 1.0, ...} over the defaults. Opening the port resets it, as the line DTR does
    on an Arduino: it is then unhomed, and in Alarm where $22=1. Raises UserError for an unknown
    setting.
    """

    def __init__(self, world: World, settings: Mapping[str, float] | None = None) -> None:
        super().__init__()
        self.world = world
        self.controller = Controller(world, settings)
        self._number, self._plugged = 0, False
        world.on_fault(KINDS, self._on_fault)

    @property
    def port(self) -> str:
        """Known once it has started; it stays when it starts again."""
        return f"socket://127.0.0.1:{self._number}"

    def start(self) -> None:
        """Serve the port."""
        server = socket.create_server(("127.0.0.1", self._number))
        self._number, self._plugged = server.getsockname()[1], True
        self.run("grbl", self._serve, server)

    def plug(self) -> None:
        """Plug it in again, under the same name."""
        self.stop()
        self.start()

    def close(self) -> None:
        """Stop the stage: its controller has no power."""
        with self.world.lock:
            self.world.follow(self.world.advance())

    def _serve(self, server: socket.socket) -> None:
        with server:
            while self._powered():
                if select.select([server], [], [], IDLE_S)[0]:
                    client, _ = server.accept()
                    with client, contextlib.suppress(OSError):
                        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                        self._talk(client)

    def _powered(self) -> bool:
        return self._plugged and not self.stopping.is_set()

    def _talk(self, client: socket.socket) -> None:
        """Serve one client until it closes the port."""
        self.stopping.wait(BOOT_S)
        with self.world.lock:
            self.controller.power_up(self.world.advance())
        while self._powered():
            wait = BUSY_S if self.controller.moving else IDLE_S
            data = b""
            if select.select([client], [], [], wait)[0]:
                data = client.recv(4096)
                if not data:
                    return
            with self.world.lock:
                self.controller.receive(data, self.world.advance())
                out = self.controller.take()
            client.sendall(out)

    def _on_fault(self, fault: Fault, t: float) -> None:
        controller = self.controller
        controller.t = max(controller.t, t)
        if fault.kind == "alarm-1":
            controller.lose(1)
        elif fault.kind == "alarm-2":
            controller.alarm(2)
        elif fault.kind == "alarm-3":
            controller.lose(3)
            controller.reset()
        elif fault.kind == "alarm-5":
            controller.blind += int(fault.value or 1)
        elif fault.kind == "no-ok":
            controller.mute += int(fault.value or 1)
        elif fault.kind == "garbled-line":
            controller.garble = True
        elif fault.kind == "hold":
            controller.hold()
        else:
            self.world.follow(t)
            self._plugged = False
