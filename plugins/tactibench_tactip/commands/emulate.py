"""``tactibench hw emulate``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from tactibench_tactip.rehearsal import Rehearsed
    from tactibench_tactip.settings import Settings

HELP = """what can be typed here:
  mount single | mount dual 11.5 | mount triple 0 1.5 3
  fault NAME [VALUE]     such as: fault protective-stop (`fault` alone lists them)
  state                  where the tool is, presses made, motion outside the envelope
  quit"""


@click.command("emulate")
@click.option(
    "--config",
    type=click.Path(path_type=Path),
    metavar="FILE.toml",
    help="Emulate what it names; default: a UR with a TacTip under it.",
)
@click.option(
    "--driver",
    type=click.Choice(["ur", "grbl"]),
    default="ur",
    show_default=True,
    help="Robot of the default setup.",
)
@click.option(
    "--write",
    "target",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE.toml",
    help="Write a commented configuration and end.",
)
@click.option(
    "--time-scale",
    type=click.FloatRange(1, 1000),
    default=1.0,
    show_default=True,
    help="How much faster than real everything happens.",
)
@click.option("--sensor", default="tactip-127", show_default=True, help="Simulated sensor.")
@click.option("--fps", type=click.FloatRange(1, 240), default=30.0, show_default=True)
def command(
    config: Path | None,
    driver: str,
    target: Path | None,
    time_scale: float,
    sensor: str,
    fps: float,
) -> None:
    """Run a robot, a camera and a sensor that are emulated, and print a configuration to use.

    Other commands then find them as they would find the devices. Type `mount dual 11.5` to change
    the indenter, `fault protective-stop` to have something go wrong, `quit` or Ctrl-C to end.
    """
    import tomllib

    from tactibench import UserError
    from tactibench_tactip.configuration import read_settings
    from tactibench_tactip.example import example
    from tactibench_tactip.rehearsal import rehearse
    from tactibench_tactip.settings import Settings

    if target is not None:
        if target.exists():
            raise UserError(f"{target} is there already; name another file.")
        target.write_text(example(driver), encoding="utf-8")
        click.echo(f"configuration: {target}")
        return
    if config is None:
        settings = Settings.model_validate(tomllib.loads(example(driver)))
    else:
        settings = read_settings(config)
    with rehearse(settings, time_scale=time_scale, sensor=sensor, fps=fps) as rehearsed:
        click.echo(_toml(_for_others(rehearsed.settings, settings)))
        click.echo(HELP, err=True)
        _converse(rehearsed)


def _converse(rehearsed: Rehearsed) -> None:
    """Do what is typed until the end of the input."""
    from tactibench import UserError

    for line in sys.stdin:
        words = line.split()
        if words[:1] == ["quit"]:
            return
        try:
            if words:
                click.echo(_done(rehearsed, words))
        except (UserError, ValueError) as error:
            click.echo(f"{error}")
    try:
        import threading

        threading.Event().wait()  # no terminal: until somebody ends it
    except KeyboardInterrupt:
        return


def _done(rehearsed: Rehearsed, words: list[str]) -> str:
    from tactibench_tactip.emulators import FAULTS, Fault
    from tactibench_tactip.settings import IndenterKeys

    world = rehearsed.world
    match words:
        case ["mount", "single"]:
            keys = IndenterKeys()
        case ["mount", "dual", distance]:
            keys = IndenterKeys(kind="dual", distance_mm=float(distance))
        case ["mount", "triple", a, b, c]:
            keys = IndenterKeys(kind="triple", heights_mm=(float(a), float(b), float(c)))
        case ["fault"]:
            return "\n".join(f"{name:<16} {text}" for name, text in FAULTS.items())
        case ["fault", name, *value]:
            world.arm(Fault(name, value=float(value[0]) if value else None))
            return f"{name} happened"
        case ["state"]:
            x, y, z, *_ = world.tool()
            return (
                f"tool at {x:.2f}, {y:.2f}, {z:.2f} mm; {world.presses:,} presses; "
                f"{len(world.log.outside)} times outside the envelope"
            )
        case _:
            return HELP
    world.mount(keys.indenter())
    return f"mounted: {' '.join(words[1:])}"


def _for_others(found: Settings, given: Settings) -> Settings:
    """The rehearsal's own watchdog is slower than a configuration may ask for."""
    keys = found.robot.model_copy(update={"watchdog_hz": given.robot.watchdog_hz})
    return found.model_copy(update={"robot": keys})


def _toml(settings: object) -> str:
    """The whole configuration as TOML that can be read again."""
    from tactibench_tactip.settings import Settings

    assert isinstance(settings, Settings)  # noqa: S101
    tables = settings.model_dump(mode="json", by_alias=True)
    lines = [f"schema = {tables.pop('schema')}"]
    for name, table in tables.items():
        lines.append(f"\n[{name}]")
        lines += [f"{key} = {_value(value)}" for key, value in table.items() if value is not None]
    return "\n".join(lines)


def _value(value: object) -> str:
    import json

    return json.dumps(value)  # strings, numbers, booleans and lists are alike in TOML
