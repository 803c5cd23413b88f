"""Options, devices and output that the verbs share."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from tactibench import UserError
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
emulate_option = click.option(
    "--emulate",
    is_flag=True,
    help="Rehearse with a simulated robot and camera; no device is opened.",
)


def number_option(
    name: str, kind: click.ParamType[Any], default: float, help_text: str
) -> Decorator:
    """Return an option of a number whose default is shown."""
    return click.option(name, type=kind, default=default, show_default=True, help=help_text)


def device_options(verb: Verb) -> Verb:
    """Add the options that choose the devices; the verb hands them to ``open_devices``."""
    return config_option(emulate_option(verb))


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
    """Print columns with two blanks between them."""
    widths = [max(len(row[k]) for row in (heads, *rows)) for k in range(len(heads))]
    for row in (heads, *rows):
        line = "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        click.echo(line.rstrip())


def format_duration(seconds: float) -> str:
    """Return "7 h 20 min", "3 min" or "12 s"."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60:02d} min" if minutes >= 60 else f"{minutes} min"


def is_quiet() -> bool:
    """Return whether the command line says --quiet: no plan and no progress is then shown."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.find_root().params.get("quiet"))


@contextmanager
def progress_bar(title: str, total: int) -> Iterator[Callable[[int], None]]:
    """Show progress on stderr; silent with --quiet, and where that is no terminal."""
    console = Console(stderr=True, highlight=False)
    columns = (
        TextColumn("{task.description:<20}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(
        *columns, console=console, transient=True, disable=is_quiet() or not console.is_terminal
    ) as progress:
        task = progress.add_task(title, total=total)
        yield lambda done: progress.advance(task, done)
