"""``tactibench hw doctor``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from tactibench_tactip.commands.common import config_options, devices, print_rows

if TYPE_CHECKING:
    from tactibench_tactip.settings import Settings

FAILED = 1


@click.command("doctor")
@config_options
def command(config: Path, emulate: bool, time_scale: float) -> int:
    """Say what of a setup is reachable and what is not as the configuration says; nothing moves.

    (A stage with robot.home = true is not homed for it.)
    """
    with devices(config, emulate, time_scale) as (settings, _):
        keys = settings.robot.model_copy(update={"home": emulate and settings.robot.home})
        settings = settings.model_copy(update={"robot": keys})
        rows = [*_checked("camera", _camera, settings), *_checked("robot", _robot, settings)]
    print_rows(("", "", "found"), [(mark, what, found) for mark, what, found in rows])
    wrong = sum(mark == "WRONG" for mark, _, _ in rows)
    click.echo(f"{wrong} of {len(rows)} wrong" if wrong else "all as the configuration says")
    return FAILED if wrong else 0


Row = tuple[str, str, str]


def _checked(
    what: str, look: Callable[[Settings], Iterator[tuple[str, str]]], settings: Settings
) -> Iterator[Row]:
    """Rows up to the first mistake."""
    from tactibench import UserError

    try:
        for name, found in look(settings):
            yield "ok", name, found
    except (UserError, OSError) as error:
        yield "WRONG", what, str(error)


def _camera(settings: Settings) -> Iterator[tuple[str, str]]:
    import time

    from tactibench import UserError
    from tactibench_tactip.camera.driver import Camera
    from tactibench_tactip.camera.gate import Reference
    from tactibench_tactip.collecting.collect import warm_up

    with Camera(settings.camera) as camera:
        shots = camera.fresh(time.monotonic_ns(), 20)
        found = camera.read_back
        assert found is not None, "open"  # noqa: S101
        height, width = shots[0].image.shape
        yield (
            "camera",
            (
                f"{settings.camera.source}: {found.backend}, {found.width} x {found.height} px "
                f"{found.fourcc}, kept {width} x {height}"
            ),
        )
        yield "frames", f"{1 / camera.period_s:.1f} a second"
        yield (
            "exposure",
            f"{found.exposure:g}, automatic {found.auto_exposure:g}, gain {found.gain:g}",
        )
        warm_up(camera, settings)
        rest = Reference.of(shots)
        yield "brightness", f"{rest.brightness:.1f} grey levels, steady; noise {rest.between:.2f}"
        pins, keys = settings.sensor.pins, settings.sensor
        if pins is not None and abs(rest.pins - pins) > keys.pins_tolerance:
            raise UserError(
                f"{rest.pins} pins are seen, sensor.pins says {pins}; draw the tool away, look at "
                "light, focus and camera.crop, or correct sensor.pins."
            )
        yield "pins", f"{rest.pins}" + ("" if pins else ", nobody counts them: set sensor.pins")


def _robot(settings: Settings) -> Iterator[tuple[str, str]]:
    from tactibench import UserError
    from tactibench_tactip.geometry.envelope import outside
    from tactibench_tactip.motion.owner import Owner
    from tactibench_tactip.robots.connect import robot_of

    robot = robot_of(settings)
    with Owner(robot, settings) as owner:
        yield "robot", ", ".join(f"{key} {value}" for key, value in robot.describe().items())
        state = owner.do(lambda mover: mover.state(), 10.0)
        if not state.normal:
            raise UserError(f"{state.words}; clear that first.")
        force = "not measured" if state.force_n is None else "measured"
        yield "state", f"{state.words}; force {force}"
        pose = owner.do(lambda mover: mover.pose(), 10.0)
        x, y, z = pose[:3]
        where = outside(settings.envelope, pose)
        if where:
            raise UserError(
                f"the tool stands at {where}; drive it into the envelope above the sensor, with "
                "the pendant or `tactibench hw jog`."
            )
        yield "tool", f"x {x:.2f}, y {y:.2f}, z {z:.2f} mm of the work frame, inside the envelope"
