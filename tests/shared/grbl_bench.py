"""A GRBL controller without a wire, on a clock that is set by hand."""

from __future__ import annotations

from collections.abc import Mapping

from emulated import GraySensor, HandClock

from tactibench_tactip.emulators import Fault, Rig, World
from tactibench_tactip.emulators.grbl.controller import Controller
from tactibench_tactip.emulators.grbl.settings import Settings
from tactibench_tactip.emulators.grbl.stage import Stage

RIG = Rig(work_frame=(-100.0, -100.0, -80.0, 180.0, 0.0, 0.0))


class Bench:
    """start: the tool at the beginning, work frame."""

    def __init__(
        self, settings: Mapping[str, float] | None = None, faults: tuple[Fault, ...] = ()
    ) -> None:
        self.clock = HandClock()
        self.world = World(GraySensor(), RIG, clock=self.clock, faults=faults)
        self.grbl = Controller(Stage(self.world), Settings(settings))
        self.start = self.world.tool()

    def power_up(self) -> list[str]:
        with self.world.lock:
            self.grbl.power_up(self.world.advance())
        return self._lines()

    def send(self, data: bytes) -> list[str]:
        """Lines that come back at once."""
        with self.world.lock:
            self.grbl.receive(data, self.world.advance())
        return self._lines()

    def say(self, line: str) -> list[str]:
        return self.send(line.encode() + b"\n")

    def after(self, seconds: float, data: bytes = b"") -> list[str]:
        """Lines that come while time passes, and back."""
        end = self.clock.t + seconds
        while self.clock.t < end:
            self.clock.t = min(self.clock.t + 0.02, end)
            with self.world.lock:
                self.grbl.step(self.world.advance())
        return self.send(data)

    def _lines(self) -> list[str]:
        return self.grbl.take().decode("latin-1").split("\r\n")[:-1]

    def status(self) -> dict[str, str]:
        """State and fields of a report."""
        state, *fields = self.send(b"?")[0].strip("<>").split("|")
        return {"state": state, **dict(field.split(":", 1) for field in fields)}

    def place(self) -> tuple[float, ...]:
        return tuple(float(value) for value in self.status()["MPos"].split(","))
