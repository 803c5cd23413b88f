"""Options, devices and output that the verbs share."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from tactibench import UserError
from tactibench.report import print_table, progress_on, table
from tactibench_tactip.settings import Settings, read_settings

Verb = Callable[..., Any]
Decorator = Callable[[Verb], Verb]

config_option = click.option(
    "--config",
    required=True,
    metavar="FILE.toml",
    type=click.Path(path_type=Path),
    help="Configuration of the setup.",
)


def number_option(
    name: str, kind: click.ParamType[Any], default: float, help_text: str
) -> Decorator:
    """Return an option of a number whose default is shown."""
    return click.option(name, type=kind, default=default, show_default=True, help=help_text)


def device_options(verb: Verb) -> Verb:
    """Add the options that choose the devices; the verb hands them to ``open_devices``."""
    emulate = click.option(
        "--emulate",
        is_flag=True,
        help="Rehearse with a simulated robot and camera; no device is opened.",
    )
    return config_option(emulate(verb))


@contextmanager
def open_devices(config: Path, emulate: bool) -> Iterator[Settings]:
    """Yield the settings to use, and print the notes of an error.

    Args:
        config: Configuration file.
        emulate: Whether to take a simulated robot and camera.

    Raises:
        UserError: The configuration has a mistake.
    """
    settings = read_settings(config)
    if emulate:
        click.echo("rehearsed with a simulated robot and camera; no device is opened", err=True)
        settings = settings.rehearsal()
    try:
        yield settings
    except (UserError, OSError, KeyboardInterrupt) as error:
        for note in getattr(error, "__notes__", ()):
            click.echo(note, err=True)
        raise


def print_rows(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table on stdout."""
    print_table(Console(highlight=False), table(heads, rows))


def is_quiet() -> bool:
    """Return whether the command line says --quiet: no plan and no progress is then shown."""
    return bool(click.get_current_context().find_root().params.get("quiet"))


def progress_bar(title: str, total: int) -> AbstractContextManager[Callable[[int], None]]:
    """Show progress on stderr, unless the command line says --quiet; yields what advances it."""
    console = Console(stderr=True, highlight=False)
    return progress_on(console, quiet=is_quiet()).task(title, total)
