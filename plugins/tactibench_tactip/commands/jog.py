"""``tactibench hw jog``."""

from __future__ import annotations

from typing import Any

import click

from tactibench import UserError
from tactibench_tactip.commands.output import device_options, number_option, open_devices
from tactibench_tactip.motion import Mover, RobotThread
from tactibench_tactip.poses import envelope_violation
from tactibench_tactip.press_geometry import geometry_of
from tactibench_tactip.press_path import SLACK_MM, clear_height, force_guard
from tactibench_tactip.robots.base import make_robot
from tactibench_tactip.settings import Pose6, Settings

LOOK_S, MOVE_S = 10.0, 120.0


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
@click.option("--home", is_flag=True, help="Drive a stage to its switches, and nothing else.")
@click.option("--yes", is_flag=True, help="Do not ask.")
def command(
    by: tuple[float, float, float] | None,
    target: tuple[float, float, float] | None,
    speed: float,
    home: bool,
    yes: bool,
    **device: Any,
) -> None:
    """Move the tool straight, inside the envelope, and say where it is.

    Without --by, --to and --home nothing moves. A tool outside the envelope may be moved into it.
    Sideways it moves only at clearance above the sensor. A robot that measures force stops at
    envelope.max_force_n. With robot.home = true a stage that is not homed is homed before it moves.
    """
    if by is not None and target is not None:
        raise UserError("give --by or --to, not both.")
    with open_devices(**device) as (settings, emulation):
        if home and settings.robot.driver != "grbl":
            raise UserError("--home is for a stage; a UR knows where it is.")
        moves = by is not None or target is not None
        # Connecting alone homes a stage: where nothing is to move, that must not happen either.
        homes = home or (moves and settings.robot.home)
        settings = settings.with_changes(robot={"home": homes})
        if (moves or home) and not yes and emulation is None:
            if settings.robot.homes:
                click.echo("A stage that is not homed drives to its switches first.", err=True)
            click.confirm("Is the way clear, and the emergency stop in reach", abort=True, err=True)
        robot = make_robot(settings)
        with RobotThread(robot, settings) as thread:
            start = thread.do(lambda mover: mover.pose(), LOOK_S)
            _print_pose(start)
            if not moves:
                return
            x, y, z = target or tuple(a + b for a, b in zip(start[:3], by or (), strict=True))
            end: Pose6 = (x, y, z, *start[3:])
            check_way(start, end, settings)

            def go(mover: Mover) -> Pose6:
                mover.go(end, speed, force_guard(mover, settings.envelope.max_force_n))
                return mover.pose()

            _print_pose(thread.do(go, MOVE_S))


def check_way(here: Pose6, there: Pose6, settings: Settings) -> None:
    """Raise UserError where a straight move must not be made; nothing has moved then.

    The envelope is a box: where both ends lie inside, the whole way does. From outside it a move
    may come in straight up or down, or at clearance, where nothing is in the way.

    Args:
        here: Present pose of the tool in the work frame.
        there: Pose to move to.
        settings: Configuration of the setup.
    """
    violation = envelope_violation(settings.envelope, there)
    if violation:
        raise UserError(f"the tool would be at {violation}; nothing was moved.")
    sideways = max(abs(a - b) for a, b in zip(here[:2], there[:2], strict=True))
    high, lowest = clear_height(geometry_of(settings), settings), max(here[2], there[2])
    if not (sideways <= SLACK_MM or lowest <= high + SLACK_MM):
        raise UserError(
            f"the tool would move sideways at z {lowest:.1f} mm, where it may touch the sensor; "
            f"move it straight up to z {high:.1f} mm first (--by 0 0 -N), then sideways, then "
            "down. Nothing was moved."
        )


def _print_pose(pose: Pose6) -> None:
    x, y, z, a, b, c = pose
    click.echo(
        f"tool at x {x:.3f}, y {y:.3f}, z {z:.3f} mm, turned by {a:.2f}, {b:.2f}, {c:.2f} deg, in "
        "the work frame"
    )
