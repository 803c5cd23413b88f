"""Clocks that are set by hand, a sensor without mechanics, and controllers without sockets."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from tactibench import Frame, Pose, Scene, Sensor, UserError
from tactibench_tactip.emulators import Fault
from tactibench_tactip.emulators.grbl_firmware import Controller as GrblController
from tactibench_tactip.emulators.motion import matrix, to_ur
from tactibench_tactip.emulators.touch import Rig
from tactibench_tactip.emulators.ur import dashboard_answer
from tactibench_tactip.emulators.ur_controller import Controller as UrController
from tactibench_tactip.emulators.world import Clock, World

DEEPEST_MM = 8.0
STAGE_RIG = Rig(work_frame=(-100.0, -100.0, -80.0, 180.0, 0.0, 0.0))
SCRIPT = "def rtde_control():\n    global reg_offset_int = # int register offset\n0\nend\n"
"""The part of ur_rtde's script that is read, as it is sent."""
TOOL = (0.0, 0.0, 89.1, 0.0, 0.0, 0.0)


class HandClock(Clock):
    """Stands still until it is told otherwise. A monotonic nanosecond is one of the world."""

    def __init__(self) -> None:
        super().__init__(1.0)
        self.t = 0.0

    def now(self) -> float:
        return self.t

    def at(self, monotonic_ns: int) -> float:
        return monotonic_ns * 1e-9


class GraySensor(Sensor):
    """Nine bright squares on black; how bright they are tells how deep the press is, 20 levels a
    mm. Deeper than 8 mm is refused."""

    def rest(self) -> Frame:
        return Frame(self._image(0.0), 0.0, Pose())

    def press(self, scene: Scene) -> Frame:
        if scene.pose.depth > DEEPEST_MM:
            raise UserError("too deep.")
        return Frame(self._image(scene.pose.depth), 0.0, scene.pose)

    def describe(self) -> dict[str, Any]:
        return {"sensor": "gray"}

    @staticmethod
    def _image(depth: float) -> np.ndarray:
        image = np.zeros((32, 32), dtype=np.uint8)
        for row in (4, 14, 24):
            for column in (4, 14, 24):
                image[row : row + 4, column : column + 4] = round(80 + 20 * depth)
        return image


class Stage:
    """A GRBL controller without a wire."""

    def __init__(self, settings: Mapping[str, float] | None = None, *faults: Fault) -> None:
        self.clock = HandClock()
        self.world = World(GraySensor(), STAGE_RIG, clock=self.clock, faults=faults)
        self.grbl = GrblController(self.world, settings)

    def power_up(self) -> list[str]:
        self.grbl.power_up(self.world.advance())
        return self._lines()

    def send(self, data: bytes) -> list[str]:
        """Lines that come back at once."""
        self.grbl.receive(data, self.world.advance())
        return self._lines()

    def say(self, line: str) -> list[str]:
        return self.send(line.encode() + b"\n")

    def after(self, seconds: float, data: bytes = b"") -> list[str]:
        """Lines that come while time passes, and back."""
        end = self.clock.t + seconds
        while self.clock.t < end:
            self.clock.t = min(self.clock.t + 0.02, end)
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


class Arm:
    """A UR controller without sockets; host: the clock between hosts, s."""

    def __init__(self, *faults: Fault, **given: Any) -> None:
        self.clock, self.host = HandClock(), 0.0
        self.world = World(GraySensor(), clock=self.clock, faults=faults)
        self.ur = UrController(self.world, TOOL, host=lambda: self.host, **given)
        self.world.on_fault({"protective-stop": lambda _, t: self.ur.protective_stop(t)})

    def load(self) -> None:
        self.ur.load(SCRIPT, self.clock.t)

    def after(self, seconds: float, host: float | None = None) -> None:
        """Let time pass, on both clocks unless the host's is given."""
        turns = max(int(seconds / 0.01), 1)
        for _ in range(turns):
            self.clock.t += seconds / turns
            self.host += (seconds if host is None else host) / turns
            self.ur.step(self.world.advance())

    def write(self, command: int, *reals: float) -> None:
        """A data package: the command, and doubles from register 0 on."""
        values = {f"input_double_register_{k}": value for k, value in enumerate(reals)}
        self.ur.inputs.update(values, input_int_register_0=float(command))
        self.ur.written(["input_int_register_0", *values], self.clock.t)

    def command(self, command: int, *reals: float) -> None:
        """As the client does it: wait for ready, write, wait for done, write 0."""
        assert self.signal == 1
        self.write(command, *reals)
        assert self.signal == 2
        self.write(0)

    def settle(self) -> None:
        """Let the motion end."""
        while self.clock.t < self.world.still_s:
            self.after(0.05)
        self.after(0.05)

    @property
    def signal(self) -> int:
        return self.ur.out_int[0]

    def ask(self, line: str) -> str:
        return dashboard_answer(self.ur, line, self.clock.t)

    def target(self, z: float) -> list[float]:
        """A TCP pose with the tool point there on the work frame's z, mm."""
        base = matrix(self.world.rig.work_frame) @ matrix((0.0, 0.0, z, 0.0, 0.0, 0.0))
        return [float(value) for value in to_ur(base)]

    def z(self) -> float:
        return self.world.tool()[2]


def finish(robot: Any) -> None:
    """Wait until a robot has ended its move."""
    while robot.moving():
        pass


def stands(world: World) -> bool:
    """Return whether the tool stands still."""
    before = world.tool()
    time.sleep(0.05)
    return world.tool() == before
