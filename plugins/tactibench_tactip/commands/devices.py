"""``tactibench hw doctor``, ``hw jog`` and ``hw example``."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from importlib.resources import files
from pathlib import Path
from typing import Any

import click

from tactibench import Pose, Scene, UserError
from tactibench_tactip.camera import Reference
from tactibench_tactip.collection import warm_up
from tactibench_tactip.commands.output import device_options, number_option, open_devices
from tactibench_tactip.geometry import envelope_violation, geometry_of
from tactibench_tactip.motion import SLACK_MM, RobotThread
from tactibench_tactip.robots import PositionUnknownError, Purpose, make_robot
from tactibench_tactip.settings import Pose6, Settings
from tactibench_tactip.station import describe_place

FAILED = 1
Vector = tuple[float, float, float]
Row = tuple[str, str, str]
"""Mark, part of the setup, finding."""


@click.command("example")
@click.argument("path", metavar="FILE.toml", type=click.Path(path_type=Path, dir_okay=False))
def example(path: Path) -> None:
    """Write a commented configuration of a UR to start from; comments tell the lines of a stage."""
    if path.exists():
        raise UserError(f"{path} is there already; name another file.")
    path.write_bytes(files("tactibench_tactip").joinpath("example.toml").read_bytes())
    click.echo(f"configuration: {path}")


@click.command("doctor")
@device_options
def doctor(**device: Any) -> int:
    """Say what of a setup is reachable and what is not as the configuration says; nothing moves.

    A stage that is not homed yet is no mistake where robot.home = true; where its tool stands is
    then not known.
    """
    with open_devices(**device) as settings:
        rows = [*check_setup(settings)]
    for mark, part, text in rows:
        click.echo(f"{mark:<5}  {part:<10}  {text}")
    wrong = sum(mark == "WRONG" for mark, _, _ in rows)
    click.echo(f"{wrong} of {len(rows)} wrong" if wrong else "all as the configuration says")
    return FAILED if wrong else 0


def check_setup(settings: Settings) -> Iterator[Row]:
    """Yield what is found of camera and robot, each up to its first mistake."""
    for part, look in (("camera", _look_at_camera), ("robot", _look_at_robot)):
        try:
            for name, text in look(settings):
                yield "ok", name, text
        except (UserError, OSError) as error:
            yield "WRONG", part, str(error)


def _look_at_camera(settings: Settings) -> Iterator[tuple[str, str]]:
    with make_robot(settings).camera(settings.camera) as camera:
        frames = camera.fresh(time.monotonic_ns(), 20)
        actual = camera.read_back
        assert actual is not None, "open"  # noqa: S101
        height, width = frames[0].image.shape
        size = f"{actual.width} x {actual.height} px {actual.fourcc}, kept {width} x {height}"
        yield "camera", f"{settings.camera.source}: {actual.backend}, {size}"
        automatic = f"automatic {actual.auto_exposure:g}, gain {actual.gain:g}"
        yield "exposure", f"{actual.exposure:g}, {automatic}"
        warm_up(camera, settings)
        yield "frames", f"{camera.check_rate():.1f} a second"
        rest = Reference.of(frames)
        yield "brightness", f"{rest.brightness:.1f} grey levels, steady; noise {rest.between:.2f}"
        rest.check_pins(settings.sensor)
        counted = settings.sensor.pins or settings.simulated
        uncounted = "" if counted else ", which are not counted: set sensor.pins"
        yield "pins", f"{rest.pins}{uncounted}"


def _look_at_robot(settings: Settings) -> Iterator[tuple[str, str]]:
    robot = make_robot(settings)
    with RobotThread(robot, settings, "look") as thread:
        yield "robot", ", ".join(f"{key} {value}" for key, value in robot.describe().items())
        try:
            state = thread.do(lambda _: thread.robot.state())
        except PositionUnknownError:
            if not settings.robot.homes:
                raise
            yield "homed", "not yet; each command that moves it homes it first (robot.home = true)"
            return
        if not state.normal:
            raise UserError(f"{state.description}; clear that first.")
        force = "not measured" if state.force_n is None else "measured"
        yield "state", f"{state.description}; force {force}"
        x, y, z, *_ = thread.do(lambda mover: mover.check_inside())
        place = f"x {x:.2f}, y {y:.2f}, z {z:.2f} mm of the work frame, inside the envelope"
        yield "tool", place + robot.proviso


@click.command("jog")
@device_options
@click.option(
    "--by",
    nargs=3,
    type=float,
    metavar="DX DY DZ",
    help="Move by so much, mm of the work frame; a positive DZ is towards the sensor.",
)
@click.option("--to", "target", nargs=3, type=float, metavar="X Y Z", help="Move there.")
@number_option("--speed", click.FloatRange(0.1, 20), 5.0, "mm/s.")
@click.option(
    "--home",
    is_flag=True,
    help="Drive a stage to its switches; where it has none, say that its position is right.",
)
@click.option("--yes", is_flag=True, help="Do not ask.")
def jog(
    by: Vector | None, target: Vector | None, speed: float, home: bool, yes: bool, **device: Any
) -> None:
    """Move the tool straight, inside the envelope, and say where it is.

    Without --by, --to and --home nothing moves, and a robot is read only. A tool outside the
    envelope may be moved into it. Sideways it moves only at clearance above the sensor. A robot
    that measures force stops at envelope.max_force_n, but never on its way up. With robot.home =
    true a stage whose position is not known is homed before it moves.
    """
    if by is not None and target is not None:
        raise UserError("give --by or --to, not both.")
    with open_devices(**device) as settings:
        if home and settings.robot.driver != "grbl":
            raise UserError("--home is for a stage; a UR knows where it is.")
        purpose: Purpose = "home" if home else "look" if by is target else "move"
        if purpose != "look" and not yes and not settings.simulated:
            if home or settings.robot.homes:
                click.echo(
                    "A stage that is not known to be homed drives to its switches first.", err=True
                )
            sure = False
            with suppress(click.Abort):  # nobody can answer
                sure = click.confirm("Is the way clear, and the emergency stop in reach", err=True)
            if not sure:
                raise UserError(
                    "nobody said that the way is clear, so nothing was moved; answer y, or say "
                    "--yes where nobody can."
                )
        with RobotThread(make_robot(settings), settings, purpose) as thread:
            start = thread.do(lambda mover: mover.pose())
            try:
                if by is None and target is None:
                    return
                x, y, z = target or tuple(a + b for a, b in zip(start[:3], by or (), strict=True))
                end: Pose6 = (x, y, z, *start[3:])
                check_way(start, end, settings)
                thread.do(lambda mover: mover.go_in_touch(end, speed, mover.force_guard()))
            finally:
                scene, geometry = Scene(settings.indenter.indenter(), Pose()), geometry_of(settings)
                slack = settings.contact.travel_mm
                click.echo(describe_place(thread, geometry, scene, slack))


def check_way(here: Pose6, there: Pose6, settings: Settings) -> None:
    """Raise UserError where a straight move must not be made; nothing has moved then.

    The envelope is a box: where both ends lie inside, the whole way does. From outside it a move
    may lead towards it, straight up or down, or at clearance, where nothing is in the way.

    Args:
        here: Present pose of the tool in the work frame.
        there: Pose to move to.
        settings: Configuration of the setup.
    """
    violation = envelope_violation(settings.envelope, there, here)
    if violation:
        raise UserError(f"the tool would be at {violation}; nothing was moved.")
    sideways = max(abs(a - b) for a, b in zip(here[:2], there[:2], strict=True))
    high, lowest = geometry_of(settings).clear_height, max(here[2], there[2])
    if not (sideways <= SLACK_MM or lowest <= high + SLACK_MM):
        raise UserError(
            f"the tool would move sideways at z {lowest:.1f} mm, where it may touch the sensor; "
            f"move it straight up to z {high:.1f} mm first (--by 0 0 -N), then sideways, then "
            "down. Nothing was moved."
        )
