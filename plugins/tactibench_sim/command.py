"""The command `tactibench sim`."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from tactibench_sim.real.command import real
from tactibench_sim.render_command import render
from tactibench_sim.validate_command import validate


@click.group(name="sim", help="Work on the simulated TacTip: tables, pictures, errors.")
def sim() -> None:
    pass


class Number(click.FloatRange):
    """A range that NaN is not in."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        number = float(super().convert(value, param, ctx))
        if math.isnan(number):
            self.fail(f"{value} is no number.", param, ctx)
        return number


@sim.command(
    help="Make the tables of single-contact fields with finite elements (half a minute each)."
)
@click.argument("out", type=click.Path(dir_okay=False, path_type=Path))
@click.option(
    "--radius",
    "radii",
    type=Number(min=1),
    multiple=True,
    help="Radius of a spherical tip, mm; inf: a plate. Repeat for several; OUT holds these only. "
    "[default: 3 and inf]",
)
@click.option("--stiffness-ratio", type=Number(min=1, max=10_000), help="E_skin / E_gel.")
@click.option("--skin", type=Number(min=0.3, max=4), help="Skin thickness, mm.")
@click.option("--planar", is_flag=True, help="Of the planar sensor's pad. [default: the dome]")
@click.option(
    "--domes",
    "around",
    is_flag=True,
    help="Of the domes around the one that ships, for sensor.instance (twenty minutes).",
)
@click.option(
    "--bounds",
    is_flag=True,
    help="The error bounds of the tables that ship, against the reference scenes (seconds).",
)
@click.option(
    "--corrections",
    "runs",
    type=click.Path(file_okay=False, path_type=Path),
    help="With corrections for contacts off the apex and for pairs, from three-dimensional runs "
    "(about an hour). They are kept in this folder: given again, it goes on where it stopped.",
)
def tabulate(
    out: Path,
    radii: tuple[float, ...],
    stiffness_ratio: float | None,
    skin: float | None,
    planar: bool,
    around: bool,
    bounds: bool,
    runs: Path | None,
) -> None:
    from tactibench import UserError
    from tactibench_sim import fem

    if not bounds:
        fem.require_ngsolve()
    if not out.parent.is_dir():
        raise UserError(f"the folder {out.parent} of OUT is not there; make it first.")
    if planar and runs is not None:
        raise UserError("--corrections are of the dome; leave out --planar or --corrections.")
    other = planar or runs is not None or radii or stiffness_ratio or skin
    if around and (other or bounds):
        raise UserError("--domes are those around the one that ships; give no other option.")
    if bounds:
        if other:
            raise UserError("--bounds are of the tables that ship; give no other option.")
        click.echo(f"{out}  sha256 {_measured(out)}")
        return
    asked = {"stiffness_ratio": stiffness_ratio, "skin": skin}
    given = {name: value for name, value in asked.items() if value is not None}
    try:
        digest = _made(out, planar, around, given, radii, _tell, runs)
    except fem.NotConvergedError as error:
        raise UserError(f"no table was written: {error}.") from None
    click.echo(f"{out}  sha256 {digest}")


def _made(
    out: Path,
    planar: bool,
    around: bool,
    given: dict[str, float],
    radii: tuple[float, ...],
    told: Callable[[str], None],
    runs: Path | None = None,
) -> str:
    from dataclasses import replace

    from tactibench_sim import fem, table
    from tactibench_sim.planar import tabulate as pad
    from tactibench_sim.tabulate import tabulate as make
    from tactibench_sim.tabulate_domes import tabulate_domes

    if around:
        return tabulate_domes(out, table.shipped(), told)
    if planar:
        return pad.tabulate(out, replace(pad.PAD, **given), radii or (3.0,), told)
    return make(out, fem.Dome(**given), radii or table.RADII, told, runs)


def _measured(out: Path) -> str:
    from tactibench_sim import reference, table, tabulate_bounds

    tables = table.shipped()
    bounds = tabulate_bounds.measured(tables, reference.shipped())
    return tabulate_bounds.write(out, tables, bounds)


def _tell(what: str) -> None:
    click.echo(f"{what} ...", err=True)


sim.add_command(real)
sim.add_command(render)
sim.add_command(validate)
