"""A setup emulated on this machine, in a process of its own, by default in real time."""

from __future__ import annotations

import multiprocessing
import os
import signal
import socket
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from multiprocessing.managers import BaseManager
from threading import Thread
from typing import Any, cast

from tactibench import Indenter, Sensor, UserError
from tactibench_tactip.emulators.camera import CameraEmulator
from tactibench_tactip.emulators.device import Fault, FaultEvent
from tactibench_tactip.emulators.grbl import GrblEmulator
from tactibench_tactip.emulators.motion import Pose6, matrix, pose6
from tactibench_tactip.emulators.touch import Rig, Truth
from tactibench_tactip.emulators.ur import DASHBOARD, UrEmulator
from tactibench_tactip.emulators.watch import Envelope
from tactibench_tactip.emulators.world import Clock, Image, World, simulated
from tactibench_tactip.settings import EnvelopeSettings, Settings

HOSTS = tuple(f"127.0.0.{k}" for k in range(2, 60))
"""Loopback addresses on which a UR may be emulated; a UR's ports are fixed."""
WATCHDOG_HZ = 0.2
"""Rate of the watchdog in a rehearsal, low because emulators and a simulated sensor share the
processor with the program."""
STAGE = {"$110": 6000.0, "$111": 6000.0, "$112": 6000.0}
"""Rates of an emulated stage, mm/min, enough for the speeds of a default configuration."""


@dataclass(frozen=True)
class HiddenOffset:
    """Offset of the sensor from its place in the configuration, which has to be found.

    Attributes:
        x: Offset along x of the work frame, mm.
        y: Offset along y of the work frame, mm.
        z: Offset along z of the work frame, mm.
        yaw: Turn about z of the work frame, deg.
    """

    x: float = 0.0
    y: float = 0.0
    z: float = 0.8
    yaw: float = 0.0


@dataclass(frozen=True)
class EmulationPlan:
    """The emulators to run.

    Attributes:
        settings: Configuration of the setup. A robot of driver cri is emulated as a UR.
        time_scale: Factor by which everything runs faster than in real time.
        sensor: Name of a simulated sensor, or a sensor that can be pickled.
        hidden: Offset of the sensor from its place in the configuration.
        faults: Faults to arm.
        fps: Frames a second of the camera.
        noise: Factor on the noise of a small camera.
        robot: Further arguments of the robot's emulator.
    """

    settings: Settings
    time_scale: float = 1.0
    sensor: str | Sensor = "tactip-127"
    hidden: HiddenOffset = HiddenOffset()
    faults: tuple[Fault, ...] = ()
    fps: float = 30.0
    noise: float = 1.0
    robot: Mapping[str, Any] = field(default_factory=dict)


class Emulation:
    """The emulators of a plan and the world that they share."""

    _world: World
    _camera: CameraEmulator
    _robot: GrblEmulator | UrEmulator

    def __init__(self, plan: EmulationPlan) -> None:
        self._plan = plan
        self._stack = ExitStack()

    def start(self) -> tuple[str, str]:
        """Start the emulators and return the addresses of the robot and of the camera.

        Raises:
            UserError: The sensor cannot be built or emulated, or an emulator cannot start.
        """
        plan, settings, enter = self._plan, self._plan.settings, self._stack.enter_context
        sensor = plan.sensor
        if isinstance(sensor, str):
            sensor = simulated(sensor)
        self._world = World(
            enter(sensor),
            _rig(settings, plan.hidden),
            faults=plan.faults,
            clock=Clock(plan.time_scale),
        )
        self._camera = enter(CameraEmulator(self._world, fps=plan.fps, noise=plan.noise))
        if settings.robot.driver == "grbl":
            stage = GrblEmulator(self._world, {**STAGE, **plan.robot.get("settings", {})})
            self._robot = enter(stage)
            return stage.port, self._camera.url
        given = {"tool": settings.frames.tcp_pose, "host": _free_host(), **plan.robot}
        arm = UrEmulator(self._world, **given)
        self._robot = enter(arm)
        return arm.host, self._camera.url

    def tool(self) -> Pose6:
        """Return the present pose of the tool in the work frame."""
        return self._world.tool()

    def truth(self, at_ns: int | None = None) -> Truth:
        """Return the state of the world now, or at a ``time.monotonic_ns`` of the latest moves.

        Raises:
            ValueError: That moment is no longer remembered.
        """
        return self._world.truth(at_ns)

    def image(self, at_ns: int | None = None) -> Image:
        """Return the sensor's image without noise, now or at a ``time.monotonic_ns``."""
        return self._world.image(at_ns)

    def presses(self) -> int:
        """Return the number of presses that have begun."""
        return self._world.presses

    def outside(self) -> list[tuple[float, Pose6]]:
        """Return time, s, and tool pose for every time that the tool left the envelope."""
        self._world.tool()
        return list(self._world.excursions)

    def fired(self) -> list[FaultEvent]:
        """Return the faults that happened, in order."""
        self._world.tool()
        return list(self._world.fired)

    def keep_to(self, settings: EnvelopeSettings | None) -> None:
        """Note every motion outside this envelope from now on; None: the tool may go anywhere."""
        self._world.keep_to(None if settings is None else _envelope(settings))

    def mount(self, indenter: Indenter) -> None:
        """Change the indenter."""
        self._world.mount(indenter)

    def arm(self, *faults: Fault) -> None:
        """Arm faults; a fault without a press happens now."""
        self._world.arm(*faults)

    def repair(self) -> None:
        """Do what a person would do after a fault: plug in, release the button, repair the skin.

        A protective stop is left to the client.
        """
        self._camera.picture.repair()
        if isinstance(self._robot, GrblEmulator):
            self._robot.plug()
        elif self._robot.controller.safety == "ROBOT_EMERGENCY_STOP":
            self._robot.controller.repair()

    def close(self) -> None:
        """Stop the emulators."""
        self._stack.close()


@dataclass(frozen=True)
class Rehearsal:
    """Running emulators, and the configuration that finds them."""

    emulation: Emulation
    settings: Settings


@contextmanager
def rehearse(settings: Settings, **options: Any) -> Iterator[Rehearsal]:
    """Emulate all that a configuration names while the block runs.

    Args:
        settings: Configuration of the setup.
        options: Further arguments of ``EmulationPlan``.

    Raises:
        UserError: The process of the emulators ended, or an emulator cannot start.
    """
    plan = EmulationPlan(settings, **options)
    with _Process(ctx=multiprocessing.get_context("spawn")) as process:
        emulation = cast("Emulation", process.emulation(plan))  # type: ignore[attr-defined]
        try:
            yield Rehearsal(emulation, _settings_for(plan, *emulation.start()))
        finally:
            emulation.close()


class _Process(BaseManager):
    """The process of the emulators.

    ur_rtde keeps Python's lock while it waits for a controller: no emulator in the same process
    could answer it.
    """

    def __enter__(self) -> _Process:
        try:
            self.start(_begin_process)
        except EOFError:
            raise UserError("the process of the emulators ended; its output says why.") from None
        return self


_Process.register("emulation", Emulation)


def _begin_process() -> None:
    """Ignore Ctrl-C, which is meant for the caller, and end when the caller ends or is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_with_parent, name="parent", daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(0)


def _settings_for(plan: EmulationPlan, robot: str, camera: str) -> Settings:
    """Return the configuration with the emulators' addresses, without what a stream cannot set."""
    settings = plan.settings
    stage = settings.robot.driver == "grbl"
    changes = {
        "driver": "grbl" if stage else "ur",
        "address": robot,
        "home": stage or settings.robot.home,
        "time_scale": plan.time_scale,
        "watchdog_hz": WATCHDOG_HZ,
    }
    unset = dict.fromkeys(("size", "exposure", "gain", "fourcc", "crop"))
    stream = {"source": camera, "fps": plan.fps, **unset}
    return settings.with_changes(robot=changes, camera=stream)


def _free_host() -> str:
    """Return a loopback address on which no UR is emulated yet.

    Raises:
        UserError: A UR is emulated on every address of HOSTS.
    """
    for host in HOSTS:
        try:
            with socket.create_server((host, DASHBOARD)):
                return host
        except OSError:
            continue
    raise UserError(f"a UR is emulated on each of {HOSTS[0]} to {HOSTS[-1]}; end one of them.")


def _rig(settings: Settings, hidden: HiddenOffset) -> Rig:
    x, y, yaw = settings.frames.sensor
    placed = matrix((x + hidden.x, y + hidden.y, hidden.z, 0.0, 0.0, yaw + hidden.yaw))
    return Rig(
        work_frame=settings.frames.work_frame,
        sensor_frame=pose6(placed @ matrix((0.0, 0.0, 0.0, 180.0, 0.0, 0.0))),
        indenter=settings.indenter.indenter(),
        start=(0.0, 0.0, -0.8 * settings.envelope.above_mm, 0.0, 0.0, 0.0),
    )


def _envelope(settings: EnvelopeSettings) -> Envelope:
    half = settings.half_width_mm
    z = (-settings.above_mm, settings.below_mm)
    return Envelope((-half, half), (-half, half), z, settings.tilt_deg)
