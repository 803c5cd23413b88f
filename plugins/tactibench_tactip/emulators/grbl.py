"""A GRBL controller behind a socket."""

from __future__ import annotations

import select
import socket
from collections.abc import Mapping
from threading import Lock

from tactibench_tactip.emulators.device import IDLE_S, Device, Fault
from tactibench_tactip.emulators.grbl_firmware import Controller
from tactibench_tactip.emulators.world import World

BUSY_S, BOOT_S = 0.004, 0.1
"""Host seconds between two looks at the clock while the stage moves, and from the opening of the
port to the banner (a real Arduino takes up to 2 s)."""


class GrblEmulator(Device):
    """A GRBL controller behind a socket; ``port`` is for ``serial.serial_for_url``.

    Opening the port resets the controller, as the line DTR does on an Arduino: it is then unhomed,
    and in Alarm where $22=1.

    Args:
        world: The world in which the stage moves.
        settings: Settings that differ from the defaults, such as {"$20": 1.0}.

    Raises:
        UserError: A setting is unknown.
    """

    def __init__(self, world: World, settings: Mapping[str, float] | None = None) -> None:
        super().__init__()
        self.world = world
        self.controller = Controller(world, settings)
        self._number = 0
        self._port_lock = Lock()
        world.on_fault(
            {
                "alarm-1": lambda _, t: self._stop_with(1, t),
                "alarm-2": lambda _, t: self._stop_with(2, t),
                "alarm-3": lambda _, t: self._stop_with(3, t),
                "alarm-5": self._break_probe,
                "no-ok": self._mute,
                "garbled-line": self._garble,
                "hold": self._hold,
                "unplug": lambda _, __: self.close(),
            }
        )

    @property
    def port(self) -> str:
        """Address of the port, known after the first start; later starts keep it."""
        return f"socket://127.0.0.1:{self._number}"

    def start(self) -> None:
        """Serve the port."""
        self._number = self.listen("127.0.0.1", self._number, self._talk)

    def plug(self) -> None:
        """Plug the port in again, under the same name."""
        self.stop()
        self.start()

    def close(self) -> None:
        """Close the port and stop the stage, whose controller loses its power."""
        super().close()
        with self.world.lock:
            self.world.follow(self.world.advance())

    def _talk(self, client: socket.socket) -> None:
        """Serve one client until it closes the port; another client waits until then."""
        with self._port_lock:
            self.stopping.wait(BOOT_S)
            with self.world.lock:
                self.controller.power_up(self.world.advance())
            while not self.stopping.is_set():
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

    def _stop_with(self, alarm: int, t: float) -> None:
        """Stop with an alarm: soft limits keep the position, a hard limit and a reset lose it."""
        controller = self.controller
        controller.t = max(controller.t, t)
        if alarm == 2:
            controller.alarm(alarm)
        else:
            controller.lose(alarm)
        if alarm == 3:
            controller.reset()

    def _break_probe(self, fault: Fault, _: float) -> None:
        self.controller.blind += int(fault.amount)

    def _mute(self, fault: Fault, _: float) -> None:
        self.controller.mute += int(fault.amount)

    def _garble(self, _: Fault, __: float) -> None:
        self.controller.garble = True

    def _hold(self, _: Fault, t: float) -> None:
        self.controller.t = max(self.controller.t, t)
        self.controller.hold()
