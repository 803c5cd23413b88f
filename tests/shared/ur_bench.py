"""A UR controller without sockets, on clocks that are set by hand."""

from __future__ import annotations

from typing import Any

from emulated import GraySensor, HandClock

from tactibench_tactip.emulators import Fault, World
from tactibench_tactip.emulators.poses import from_ur, to_ur
from tactibench_tactip.emulators.ur.arm import Arm
from tactibench_tactip.emulators.ur.controller import Controller
from tactibench_tactip.emulators.ur.dashboard import DashboardSession

SCRIPT = """def rtde_control():
    global reg_offset_float = # float register offset
{floats}    global reg_offset_int = # int register offset
{ints}    global force_mode_type = 2
end
"""
"""The part of ur_rtde's script that is read, as it is sent."""
TOOL = (0.0, 0.0, 89.1, 0.0, 0.0, 0.0)


class UrBench:
    """host: the clock between hosts, s."""

    def __init__(
        self,
        version: tuple[int, ...] = (5, 12, 2, 1101534),
        faults: tuple[Fault, ...] = (),
        **given: Any,
    ) -> None:
        self.clock, self.host = HandClock(), 0.0
        self.world = World(GraySensor(), clock=self.clock, faults=faults)
        self.arm = Arm(self.world, TOOL, TOOL)
        keys = {"remote": True, "stop_force_n": 50.0, "contact_force_n": 2.0, "unlock_delay_s": 5.0}
        self.ur = Controller(
            self.world,
            self.arm,
            version,  # type: ignore[arg-type]
            **{**keys, **given},
            host=lambda: self.host,
        )
        self.dashboard = DashboardSession(self.ur, "20225500001")
        self.offset = 0

    def load(self, offset: int = 0) -> None:
        self.offset = offset
        self.ur.load(SCRIPT.format(floats=offset, ints=offset), self.clock.t)

    def after(self, seconds: float, host: float | None = None) -> None:
        """Let time pass, on both clocks unless the host's is given."""
        turns = max(int(seconds / 0.01), 1)
        for _ in range(turns):
            self.clock.go(seconds / turns)
            self.host += (seconds if host is None else host) / turns
            self.ur.step(self.world.advance())

    def write(self, command: int, reals: list[float] | None = None, **whole: int) -> None:
        """A data package: command, doubles from register 0 on, i1=... for integers."""
        values = {f"input_int_register_{self.offset}": float(command)}
        for k, value in enumerate(reals or []):
            values[f"input_double_register_{k + self.offset}"] = value
        for name, number in whole.items():
            values[f"input_int_register_{int(name[1:]) + self.offset}"] = number
        self.ur.inputs.update(values)
        self.ur.written(tuple(values), self.clock.t)

    def command(self, command: int, reals: list[float] | None = None, **whole: int) -> None:
        """As the client does it: wait for ready, write, wait for done, write 0."""
        assert self.signal == 1
        self.write(command, reals, **whole)
        for _ in range(2000):
            if self.signal == 2 or self.ur.script is None:
                break
            self.after(0.01)
        self.after(0.01)
        self.write(0)
        self.after(0.01)

    @property
    def signal(self) -> int:
        return self.ur.out_int[self.offset]

    def ask(self, line: str) -> str:
        return self.dashboard.feed(line.encode() + b"\n", self.clock.t).decode().strip()

    def target(self, x: float, y: float, z: float) -> list[float]:
        """A TCP pose with the tool point there in the work frame, mm."""
        from tactibench_tactip.emulators.poses import matrix

        base = matrix(self.world.rig.work_frame) @ matrix((x, y, z, 0.0, 0.0, 0.0))
        return [float(value) for value in to_ur(base)]

    def z(self) -> float:
        return self.world.tool()[2]

    def pose(self) -> Any:
        return from_ur(self.arm.pose(self.clock.t))
