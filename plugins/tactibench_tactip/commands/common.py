"""What the verbs share: the configuration, real or emulated devices, output."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from tactibench_tactip.rehearsal import Rehearsed
    from tactibench_tactip.settings import Settings

Verb = Callable[..., Any]


def config_options(verb: Verb) -> Verb:
    """``--config``, and ``--emulate`` with its time scale."""
    options = (
        click.option(
            "--config",
            "config",
            required=True,
            metavar="FILE.toml",
            type=click.Path(path_type=Path),
            help="Configuration of the setup.",
        ),
        click.option("--emulate", is_flag=True, help="Rehearse on emulators; no device is opened."),
        click.option(
            "--time-scale",
            type=click.FloatRange(1, 1000),
            default=20.0,
            show_default=True,
            help="How much faster than real the emulators run.",
        ),
    )
    for option in reversed(options):
        verb = option(verb)
    return verb


json_option = click.option(
    "--json",
    "json_file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the figures here.",
)


@contextmanager
def devices(
    config: Path, emulate: bool, time_scale: float, **more: Any
) -> Iterator[tuple[Settings, Rehearsed | None]]:
    """The settings to use, and the emulated world if there is one. Raises UserError."""
    from tactibench_tactip.configuration import read_settings

    settings = read_settings(config)
    if not emulate:
        with notes_told():
            yield settings, None
        return
    from tactibench_tactip.rehearsal import rehearse

    click.echo(f"emulated, {time_scale:g} times as fast as real; no device is opened", err=True)
    with notes_told(), rehearse(settings, time_scale=time_scale, **more) as rehearsed:
        yield rehearsed.settings, rehearsed


@contextmanager
def notes_told() -> Iterator[None]:
    """Say what was noted at an error of which otherwise one sentence is shown."""
    from tactibench import UserError

    try:
        yield
    except (UserError, OSError, KeyboardInterrupt) as error:
        for note in getattr(error, "__notes__", ()):
            click.echo(note, err=True)
        raise


def print_rows(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Columns with two blanks between them."""
    widths = [max(len(row[k]) for row in (heads, *rows)) for k in range(len(heads))]
    for row in (heads, *rows):
        line = "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        click.echo(line.rstrip())


def write_figures(path: Path | None, rows: Sequence[tuple[str, str, Any, str]]) -> None:
    """(metric, group, value, unit) as the other verbs write them; no file: nothing."""
    if path is None:
        return
    from tactibench.lab import write_json

    keys = ("metric", "group", "value", "unit")
    write_json(path, [dict(zip(keys, row, strict=True)) for row in rows])


def hours(seconds: float) -> str:
    """ "7 h 20 min", "3 min" or "12 s"."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60:02d} min" if minutes >= 60 else f"{minutes} min"


@contextmanager
def bar(title: str, total: int) -> Iterator[Callable[[int], None]]:
    """Progress on stderr; silent where that is no terminal."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True, highlight=False)
    with Progress(
        TextColumn("{task.description:<20}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as progress:
        job = progress.add_task(title, total=total)
        yield lambda done: progress.advance(job, done)
