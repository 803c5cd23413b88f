"""``tactibench hw doctor``."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import click

from tactibench import UserError
from tactibench_tactip.camera import Camera
from tactibench_tactip.collection import warm_up
from tactibench_tactip.commands.output import device_options, open_devices, print_rows
from tactibench_tactip.errors import NotHomedError
from tactibench_tactip.frame_check import Reference
from tactibench_tactip.motion import RobotThread
from tactibench_tactip.poses import envelope_violation
from tactibench_tactip.robots.base import Robot, make_robot
from tactibench_tactip.settings import Settings

FAILED = 1
LOOK_S = 10.0
RATE_FRAMES = 30
"""Frames over which the camera's rate is measured."""
Row = tuple[str, str, str]
"""Mark, part of the setup, finding."""


@click.command("doctor")
@device_options
def command(**device: Any) -> int:
    """Say what of a setup is reachable and what is not as the configuration says; nothing moves.

    A stage that is not homed yet is no mistake where robot.home = true; where its tool stands is
    then not known.
    """
    with open_devices(**device) as (settings, _):
        rows = [*_check("camera", _camera, settings), *_check("robot", _robot, settings)]
    print_rows(("", "", "found"), rows)
    wrong = sum(mark == "WRONG" for mark, _, _ in rows)
    click.echo(f"{wrong} of {len(rows)} wrong" if wrong else "all as the configuration says")
    return FAILED if wrong else 0


def _check(
    part: str, look: Callable[[Settings], Iterator[tuple[str, str]]], settings: Settings
) -> Iterator[Row]:
    """Yield the rows of a part up to the first mistake."""
    try:
        for name, text in look(settings):
            yield "ok", name, text
    except (UserError, OSError) as error:
        yield "WRONG", part, str(error)


def _camera(settings: Settings) -> Iterator[tuple[str, str]]:
    with Camera(settings.camera) as camera:
        frames = camera.fresh(time.monotonic_ns(), 20)
        actual = camera.read_back
        assert actual is not None, "open"  # noqa: S101
        height, width = frames[0].image.shape
        size = f"{actual.width} x {actual.height} px {actual.fourcc}, kept {width} x {height}"
        yield "camera", f"{settings.camera.source}: {actual.backend}, {size}"
        automatic = f"automatic {actual.auto_exposure:g}, gain {actual.gain:g}"
        yield "exposure", f"{actual.exposure:g}, {automatic}"
        warm_up(camera, settings)
        # Not before: the first frames of a stream wait in its buffer and come all at once.
        begin, before = time.monotonic(), camera.frames
        camera.fresh(time.monotonic_ns(), RATE_FRAMES)
        rate = (camera.frames - before) / (time.monotonic() - begin)
        yield "frames", f"{rate:.1f} a second"
        rest = Reference.of(frames)
        yield "brightness", f"{rest.brightness:.1f} grey levels, steady; noise {rest.between:.2f}"
        if rest.pins_differ(settings.sensor):
            raise UserError(
                f"{rest.pins} pins are seen, sensor.pins says {settings.sensor.pins}; draw the "
                "tool away, look at light, focus and camera.crop, or correct sensor.pins."
            )
        uncounted = "" if settings.sensor.pins else ", which are not counted: set sensor.pins"
        yield "pins", f"{rest.pins}{uncounted}"


def _robot(settings: Settings) -> Iterator[tuple[str, str]]:
    still = settings.with_changes(robot={"home": False})  # connecting must not move it
    robot = make_robot(still)
    with ExitStack() as stack:
        try:
            thread = stack.enter_context(RobotThread(robot, still))
        except NotHomedError:
            if not settings.robot.home:
                raise
            yield "robot", _describe(robot)
            yield "homed", "not yet; each command that moves it homes it first (robot.home = true)"
            return
        yield "robot", _describe(robot)
        state = thread.do(lambda mover: mover.state(), LOOK_S)
        if not state.normal:
            raise UserError(f"{state.description}; clear that first.")
        force = "not measured" if state.force_n is None else "measured"
        yield "state", f"{state.description}; force {force}"
        pose = thread.do(lambda mover: mover.pose(), LOOK_S)
        violation = envelope_violation(settings.envelope, pose)
        if violation:
            raise UserError(
                f"the tool stands at {violation}; drive it into the envelope above the sensor, "
                "with the pendant or `tactibench hw jog`."
            )
        x, y, z = pose[:3]
        yield "tool", f"x {x:.2f}, y {y:.2f}, z {z:.2f} mm of the work frame, inside the envelope"


def _describe(robot: Robot) -> str:
    return ", ".join(f"{key} {value}" for key, value in robot.describe().items())
