"""A whole setup emulated on this machine: the configuration's robot, camera and sensor."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

from tactibench import UserError
from tactibench_tactip.emulators import (
    CameraEmulator,
    Envelope,
    Fault,
    GrblEmulator,
    Rig,
    UrEmulator,
    World,
    simulated,
)
from tactibench_tactip.geometry.frames import Array, matrix, pose_of
from tactibench_tactip.robots.ur_dashboard import PORT as DASHBOARD
from tactibench_tactip.settings import EnvelopeKeys, Pose6, Settings

HOSTS = tuple(f"127.0.0.{k}" for k in range(2, 60))
"""Loopback addresses on which a UR may be emulated; a UR's ports are fixed."""
WATCHDOG_HZ = 0.2
"""Of a rehearsal: emulators and a simulated sensor share the processor with what is rehearsed."""
STAGE_MM_MIN, STAGE_MM_S2 = 6000.0, 500.0


@dataclass(frozen=True)
class Rehearsed:
    """world: what is so. settings: the configuration with the emulators' addresses. robot, camera:
    the emulators."""

    world: World
    settings: Settings
    robot: Any
    camera: CameraEmulator


@dataclass(frozen=True)
class Hidden:
    """What the configuration does not know: how far the sensor sits from where it says, in the
    work frame, mm and deg about its z."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.8
    yaw: float = 0.0


@contextmanager
def rehearse(
    settings: Settings,
    *,
    time_scale: float = 20.0,
    sensor: str = "tactip-127",
    parameters: dict[str, Any] | None = None,
    hidden: Hidden = Hidden(),
    faults: tuple[Fault, ...] = (),
    fps: float = 60.0,
    host: str | None = None,
    stream: str = "lossless",
    **robot: Any,
) -> Iterator[Rehearsed]:
    """Emulators of all that a configuration names, and the configuration that finds them.

    A robot of driver cri is rehearsed as a UR. parameters: of the simulated sensor. robot: further
    arguments of the robot's emulator.
    """
    rig = _rig(settings, hidden)
    with ExitStack() as stack:
        shown = stack.enter_context(simulated(sensor, **(parameters or {})))
        world = stack.enter_context(
            World(
                shown,
                rig,
                envelope=envelope_of(settings.envelope),
                time_scale=time_scale,
                faults=faults,
            )
        )
        camera = stack.enter_context(CameraEmulator(world, fps=fps, stream=stream))
        emulated: Any
        if settings.robot.driver == "grbl":
            rates = dict.fromkeys(("$110", "$111", "$112"), STAGE_MM_MIN)
            acceleration = dict.fromkeys(("$120", "$121", "$122"), STAGE_MM_S2)
            given = {**rates, **acceleration, **robot.pop("settings", {})}
            world.keep_to(None)  # until it has come in from its switches
            emulated = stack.enter_context(GrblEmulator(world, settings=given, **robot))
            address = {"driver": "grbl", "address": emulated.port, "home": True}
        else:
            tool = settings.frames.tcp_pose
            emulated = stack.enter_context(_ur(world, host, tool=tool, **robot))
            address = {"driver": "ur", "address": emulated.host}
        given_keys = {**address, "time_scale": time_scale, "watchdog_hz": WATCHDOG_HZ}
        keys = settings.robot.model_copy(update=given_keys)
        seen = settings.camera.model_copy(
            update={
                "source": camera.url,
                "fps": fps,
                "size": None,
                "exposure": None,
                "gain": None,
                "fourcc": None,
                "crop": None,
            }
        )
        found = settings.model_copy(update={"robot": keys, "camera": seen})
        yield Rehearsed(world, found, emulated, camera)


def _ur(world: World, host: str | None, **given: Any) -> UrEmulator:
    """A UR that listens, at an address where nobody else does."""
    if host is not None:
        return UrEmulator(world, host, **given)
    for free in HOSTS:
        try:
            with socket.create_server((free, DASHBOARD)):
                return UrEmulator(world, free, **given)
        except OSError:
            continue
    raise UserError(f"a UR is emulated on each of {HOSTS[0]} to {HOSTS[-1]}; end one of them.")


def _rig(settings: Settings, hidden: Hidden) -> Rig:
    x, y, yaw = settings.frames.sensor
    true: Array = matrix((x + hidden.x, y + hidden.y, hidden.z, 0.0, 0.0, yaw + hidden.yaw))
    start: Pose6 = (0.0, 0.0, -0.8 * settings.envelope.above_mm, 0.0, 0.0, 0.0)
    return Rig(
        work_frame=settings.frames.work_frame,
        sensor_frame=pose_of(true @ matrix((0.0, 0.0, 0.0, 180.0, 0.0, 0.0))),
        indenter=settings.indenter.indenter(),
        start=start,
    )


def envelope_of(keys: EnvelopeKeys) -> Envelope:
    """As the emulator looks for it, which is written apart from what the drivers check."""
    half = keys.half_width_mm
    return Envelope((-half, half), (-half, half), (-keys.above_mm, keys.below_mm), keys.tilt_deg)
