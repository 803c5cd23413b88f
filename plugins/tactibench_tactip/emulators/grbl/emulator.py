"""The GRBL emulator: a controller, its wire and the thread between them."""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping

from tactibench_tactip.emulators.device import Device
from tactibench_tactip.emulators.faults import Fault
from tactibench_tactip.emulators.grbl.controller import Controller
from tactibench_tactip.emulators.grbl.link import PtyLink, SocketLink, check_link, new_link
from tactibench_tactip.emulators.grbl.settings import Settings
from tactibench_tactip.emulators.grbl.stage import Stage
from tactibench_tactip.emulators.world import World

BUSY_S, IDLE_S = 0.004, 0.02
BOOT_S = 0.1
"""Host seconds: between looks at the clock while it moves and while it does not, and from opening
the port to the banner (a real Arduino takes up to 2 s)."""
KINDS = ("alarm-1", "alarm-2", "alarm-3", "alarm-5", "no-ok", "garbled-line", "unplug", "hold")


class GrblEmulator(Device):
    """A GRBL 1.1h controller. ``port`` is for ``serial.serial_for_url``.

    link: "pty" (a path; not on Windows) or "socket" (socket://127.0.0.1:N). settings:
    {"$20": 1.0, ...} over the defaults: $13=0, $20=1, $21=1, $22=1, 3000 mm/min, 500 mm/s2, travel
    200 mm. Opening the port resets it, as the line DTR does on an Arduino: it is then unhomed, and
    in Alarm where $22=1; the banner comes 0.1 s later. The machine's coordinates, once it is
    homed, are the base frame of ``Rig.work_frame``, with the switches at 0 and the travel below;
    the stage cannot rotate. A reset in motion or a hard limit loses steps, so that what it reports
    is wrong until it is homed again. Raises UserError for an unknown link or setting.
    """

    def __init__(
        self, world: World, *, link: str = "pty", settings: Mapping[str, float] | None = None
    ) -> None:
        super().__init__()
        self.world = world
        check_link(link)
        self._kind = link
        self._controller = Controller(Stage(world), Settings(settings))
        self._link: PtyLink | SocketLink | None = None
        self._plugged = False
        world.answer(KINDS, self._fault)

    @property
    def port(self) -> str:
        """Known once it has started; it stays when it starts again."""
        return self._link.port if self._link is not None else ""

    def start(self) -> None:
        """Serve the port."""
        last = self._link
        folder = last.folder if isinstance(last, PtyLink) else None
        number = last.number if isinstance(last, SocketLink) else 0
        self._link, self._plugged = new_link(self._kind, folder, number), True
        self.run("grbl", self._serve, self._link)

    def plug(self) -> None:
        """Plug it in again, under the same name."""
        self.stop()
        self.start()

    def close(self) -> None:
        with self.world.lock:  # the stage stops when its controller has no power
            self._controller.planner.halt(self.world.advance())

    def stop(self) -> None:
        super().stop()
        if isinstance(self._link, PtyLink):
            shutil.rmtree(self._link.folder, ignore_errors=True)

    def _serve(self, link: PtyLink | SocketLink) -> None:
        try:
            self._talk(link)
        finally:
            link.close()

    def _talk(self, link: PtyLink | SocketLink) -> None:
        controller = self._controller
        open_since: float | None = None
        booted = False
        while not self.stopping.is_set() and self._plugged:
            if not link.connected():
                open_since, booted = None, False
                self.stopping.wait(IDLE_S / 4)
                continue
            now = time.monotonic()
            open_since = open_since or now
            data = link.wait(BUSY_S if controller.moving or not booted else IDLE_S)
            with self.world.lock:
                t = self.world.advance()
                if not booted:
                    if now - open_since < BOOT_S:
                        continue
                    booted = True
                    controller.power_up(t)
                    data = b""
                controller.receive(data, t)
                out = controller.take()
            if out:
                link.write(out)

    def _fault(self, fault: Fault, t: float) -> None:
        controller = self._controller
        controller.at(t)
        if fault.kind == "alarm-1":
            controller.lose(1)
        elif fault.kind == "alarm-2":
            controller.planner.halt(t)
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
            controller.planner.halt(t)
            self._plugged = False
