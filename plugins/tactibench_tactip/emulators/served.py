"""The process of ``Apart``: it builds the emulators of a setup and answers calls on a pipe."""

from __future__ import annotations

import signal
from contextlib import ExitStack
from multiprocessing.connection import Connection
from typing import Any

from tactibench import UserError
from tactibench_tactip.emulators.camera import CameraEmulator
from tactibench_tactip.emulators.grbl import GrblEmulator
from tactibench_tactip.emulators.setup import Ports, Setup
from tactibench_tactip.emulators.ur import UrEmulator
from tactibench_tactip.emulators.world import World, simulated


def serve(pipe: Connection, setup: Setup) -> None:
    """The process: until the pipe closes. A Ctrl-C is meant for the caller."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with ExitStack() as stack:
        try:
            world, devices = _built(setup, stack)
        except (UserError, TypeError) as error:
            pipe.send(error if isinstance(error, UserError) else UserError(f"{error}."))
            return
        ports = Ports(
            ur=devices["ur"].host if "ur" in devices else None,
            grbl=devices["grbl"].port if "grbl" in devices else None,
            camera=devices["camera"].url if "camera" in devices else None,
        )
        pipe.send((ports, world.clock))
        while True:
            try:
                name, arguments = pipe.recv()
            except (EOFError, OSError):
                return
            pipe.send(_done(world, devices, name, arguments))


def _built(setup: Setup, stack: ExitStack) -> tuple[World, dict[str, Any]]:
    sensor = setup.sensor
    if isinstance(sensor, str):
        sensor = simulated(sensor, **setup.parameters)
    world = World(
        stack.enter_context(sensor),
        setup.rig,
        envelope=setup.envelope,
        time_scale=setup.time_scale,
        press_depth_mm=setup.press_depth_mm,
        faults=(),
    )
    kinds = {"ur": UrEmulator, "grbl": GrblEmulator, "camera": CameraEmulator}
    given = {"ur": setup.ur, "grbl": setup.grbl, "camera": setup.camera}
    devices = {
        name: stack.enter_context(kinds[name](world, **keywords))
        for name, keywords in given.items()
        if keywords is not None
    }
    world.arm(*setup.faults)
    return world, devices


def _done(world: World, devices: dict[str, Any], name: str, arguments: tuple[Any, ...]) -> Any:
    """The answer to a call; what it raised is sent back as it is."""
    try:
        needed = {"plug": "grbl", "messages": "ur"}.get(name)
        if needed is not None and needed not in devices:
            raise UserError(f"there is no {needed} among the emulators of this setup.")
        if name == "plug":
            return devices["grbl"].plug()
        if name == "messages":
            return tuple(devices["ur"].controller.messages)
        if name in {"presses", "fired", "log"}:
            return getattr(world, name)
        return getattr(world, name)(*arguments)
    except (UserError, ValueError, TypeError) as error:
        return error
