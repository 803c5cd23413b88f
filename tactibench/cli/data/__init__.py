"""``tactibench data``: data sets on the disk, from and to other formats."""

from __future__ import annotations

from importlib import import_module

import click

from tactibench.errors import UserError, did_you_mean

ACTIONS = {
    "export": ("tactibench.cli.data.export:export", "write a data set in another format"),
    "fit": ("tactibench.cli.data.fit:fit", "fit the geometry behind the labels of a recording"),
    "generate": ("tactibench.cli.data.generate:generate", "press a sensor and keep the frames"),
    "import": ("tactibench.cli.data.importing:import_folder", "read a recording into a data set"),
    "info": ("tactibench.cli.data.info:info", "what a folder holds, and what it can serve"),
    "verify": ("tactibench.cli.data.verify:verify", "check every frame of a data set"),
}


class _Actions(click.Group):
    """Actions by name, imported when they are called."""

    def list_commands(self, _ctx: click.Context) -> list[str]:
        return sorted(ACTIONS)

    def get_command(self, _ctx: click.Context, name: str) -> click.Command | None:
        if name not in ACTIONS:
            raise UserError(f"unknown command 'data {name}'; {did_you_mean(name, ACTIONS)}")
        module, _, attribute = ACTIONS[name][0].partition(":")
        command: click.Command = getattr(import_module(module), attribute)
        return command

    def format_commands(self, _ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, summary) for name, (_, summary) in sorted(ACTIONS.items())])


@click.group(cls=_Actions)
def data() -> None:
    """Data sets on the disk: read recordings, check, share and describe them."""
