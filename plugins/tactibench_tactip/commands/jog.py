"""``tactibench hw jog``."""

from __future__ import annotations

from pathlib import Path

import click

from tactibench_tactip.commands.common import config_options, devices


@click.command("jog")
@config_options
@click.option(
    "--by",
    nargs=3,
    type=float,
    metavar="DX DY DZ",
    help="Move by so much, mm of the work frame; a positive DZ is towards the sensor.",
)
@click.option("--to", "target", nargs=3, type=float, metavar="X Y Z", help="Move there.")
@click.option(
    "--speed", type=click.FloatRange(0.1, 20), default=5.0, show_default=True, help="mm/s."
)
@click.option("--home", is_flag=True, help="Drive a stage to its switches, and nothing else.")
@click.option("--yes", is_flag=True, help="Do not ask.")
def command(
    config: Path,
    emulate: bool,
    time_scale: float,
    by: tuple[float, float, float] | None,
    target: tuple[float, float, float] | None,
    speed: float,
    home: bool,
    yes: bool,
) -> None:
    """Move the tool straight, inside the envelope, and say where it is.

    Without --by and --to nothing moves. A tool outside the envelope may be moved into it.
    """
    from tactibench import UserError
    from tactibench_tactip.geometry.envelope import outside
    from tactibench_tactip.motion.mover import Mover
    from tactibench_tactip.motion.owner import Owner
    from tactibench_tactip.robots.base import Homes
    from tactibench_tactip.robots.connect import robot_of
    from tactibench_tactip.settings import Pose6

    if by is not None and target is not None:
        raise UserError("give --by or --to, not both.")
    with devices(config, emulate, time_scale) as (settings, _):
        if home:
            keys = settings.robot.model_copy(update={"home": True})
            settings = settings.model_copy(update={"robot": keys})
        robot = robot_of(settings)
        if home and not isinstance(robot, Homes):
            raise UserError("--home is for a stage; a UR knows where it is.")
        if (by or target or home) and not (yes or emulate):
            click.confirm("Is the way clear, and the emergency stop in reach", abort=True, err=True)
        with Owner(robot, settings) as owner:
            here = owner.do(lambda mover: mover.pose(), 10.0)
            click.echo(_words(here))
            if by is None and target is None:
                return
            x, y, z = target or tuple(a + b for a, b in zip(here[:3], by or (), strict=True))
            there: Pose6 = (x, y, z, *here[3:])
            wrong = outside(settings.envelope, there)
            if wrong:
                raise UserError(f"the tool would be at {wrong}; nothing was moved.")

            def go(mover: Mover) -> Pose6:
                mover.go(there, speed)
                return mover.pose()

            click.echo(_words(owner.do(go, 120.0)))


def _words(pose: tuple[float, ...]) -> str:
    x, y, z, a, b, c = pose
    return (
        f"tool at x {x:.3f}, y {y:.3f}, z {z:.3f} mm, turned by {a:.2f}, {b:.2f}, {c:.2f} deg, in "
        "the work frame"
    )
