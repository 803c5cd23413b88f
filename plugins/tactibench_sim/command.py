"""The command `tactibench sim`."""

from __future__ import annotations

from pathlib import Path

import click


@click.group(name="sim", help="Work on the simulated TacTip.")
def sim() -> None:
    pass


@sim.command(help="Make the table of single-contact fields with finite elements (about a minute).")
@click.argument("out", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--stiffness-ratio", type=click.FloatRange(min=1), help="E_skin / E_gel.")
@click.option("--skin", type=click.FloatRange(min=0.3, max=5), help="Skin thickness, mm.")
def tabulate(out: Path, stiffness_ratio: float | None, skin: float | None) -> None:
    from tactibench import UserError
    from tactibench_sim import fem
    from tactibench_sim.tabulate import tabulate as make

    fem.require_ngsolve()
    if not out.parent.is_dir():
        raise UserError(f"the folder {out.parent} of OUT is not there; make it first.")
    asked = {"stiffness_ratio": stiffness_ratio, "skin": skin}
    dome = fem.Dome(**{name: value for name, value in asked.items() if value is not None})
    try:
        digest = make(out, dome, lambda shape: click.echo(f"{shape} ...", err=True))
    except fem.NotConvergedError as error:
        raise UserError(f"no table was written: {error}.") from None
    click.echo(f"{out}  sha256 {digest}")
