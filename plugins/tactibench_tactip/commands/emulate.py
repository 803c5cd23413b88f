"""``tactibench hw emulate``."""

from __future__ import annotations

import json
import sys
import threading
import tomllib
from contextlib import suppress
from pathlib import Path

import click

from tactibench import UserError
from tactibench_tactip.commands.output import time_scale_option
from tactibench_tactip.emulators import FAULTS, Emulation, Fault, rehearse
from tactibench_tactip.settings import (
    IndenterSettings,
    Settings,
    example_configuration,
    read_settings,
)

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
@time_scale_option
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
    if target is not None:
        if target.exists():
            raise UserError(f"{target} is there already; name another file.")
        target.write_text(example_configuration(driver), encoding="utf-8")
        click.echo(f"configuration: {target}")
        return
    if config is None:
        settings = Settings.model_validate(tomllib.loads(example_configuration(driver)))
    else:
        settings = read_settings(config)
    with rehearse(settings, time_scale=time_scale, sensor=sensor, fps=fps) as rehearsal:
        # The rehearsal's own watchdog is slower than a configuration may ask for.
        watchdog = {"watchdog_hz": settings.robot.watchdog_hz}
        click.echo(as_toml(rehearsal.settings.with_changes(robot=watchdog)))
        click.echo(HELP, err=True)
        _converse(rehearsal.emulation)


def _converse(emulation: Emulation) -> None:
    """Carry out typed lines; at the end of the input wait until somebody ends the program."""
    for line in sys.stdin:
        words = line.split()
        if words[:1] == ["quit"]:
            return
        try:
            if words:
                click.echo(_carry_out(emulation, words))
        except (UserError, ValueError) as error:
            click.echo(f"{error}")
    with suppress(KeyboardInterrupt):
        threading.Event().wait()


def _carry_out(emulation: Emulation, words: list[str]) -> str:
    """Carry out one line, and return the text to print."""
    match words:
        case ["mount", "single"]:
            indenter = IndenterSettings()
        case ["mount", "dual", distance]:
            indenter = IndenterSettings(kind="dual", distance_mm=float(distance))
        case ["mount", "triple", a, b, c]:
            indenter = IndenterSettings(kind="triple", heights_mm=(float(a), float(b), float(c)))
        case ["fault"]:
            return "\n".join(f"{name:<16} {text}" for name, text in FAULTS.items())
        case ["fault", name, *value]:
            emulation.arm(Fault(name, value=float(value[0]) if value else None))
            if emulation.fired()[-1].handled:
                return f"{name} happened"
            return f"{name} did not happen: no device that is emulated here can have it"
        case ["state"]:
            x, y, z, *_ = emulation.tool()
            outside = len(emulation.outside())
            return (
                f"tool at {x:.2f}, {y:.2f}, {z:.2f} mm; {emulation.presses():,} presses; "
                f"{outside} times outside the envelope"
            )
        case _:
            return HELP
    emulation.mount(indenter.indenter())
    return f"mounted: {' '.join(words[1:])}"


def as_toml(settings: Settings) -> str:
    """Return the configuration as TOML; strings, numbers, booleans and lists are as in JSON."""
    tables = settings.model_dump(mode="json", by_alias=True)
    lines = [f"schema = {tables.pop('schema')}"]
    for name, table in tables.items():
        lines.append(f"\n[{name}]")
        lines += [f"{k} = {json.dumps(value)}" for k, value in table.items() if value is not None]
    return "\n".join(lines)
