"""The command group `tactibench sim`."""

from __future__ import annotations

import click

from tactibench_sim.commands.real import real
from tactibench_sim.commands.render import render
from tactibench_sim.commands.validate import validate


@click.group(name="sim", help="Work on the simulated sensors: pictures, errors, calibration.")
def sim() -> None:
    """Hold the subcommands."""


sim.add_command(real)
sim.add_command(render)
sim.add_command(validate)
