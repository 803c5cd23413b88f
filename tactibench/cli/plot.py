"""``tactibench plot``: figures of boards and sensors."""

from __future__ import annotations

from importlib import import_module

import click

FIGURES = ("curve", "frontier", "limit", "stability")


class Figures(click.Group):
    """A figure a command, imported when it is asked for."""

    def list_commands(self, _ctx: click.Context) -> list[str]:
        return list(FIGURES)

    def get_command(self, _ctx: click.Context, name: str) -> click.Command | None:
        if name not in FIGURES:
            return None
        command: click.Command = getattr(import_module(f"tactibench.cli.{name}"), name)
        return command


@click.command(cls=Figures)
def plot() -> None:
    """Show a figure's numbers, and draw it with --out FILE.png."""
