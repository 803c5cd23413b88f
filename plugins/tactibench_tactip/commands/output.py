"""Options, devices and output that the verbs share."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from tactibench import UserError
from tactibench.lab import write_json
from tactibench_tactip.emulators import Emulation, rehearse
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
json_option = click.option(
    "--json",
    "json_file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the figures here.",
)
emulate_option = click.option(
    "--emulate", is_flag=True, help="Rehearse on emulators; no device is opened."
)


def number_option(
    name: str, kind: click.ParamType[Any], default: float, help_text: str
) -> Decorator:
    """Return an option of a number whose default is shown."""
    return click.option(name, type=kind, default=default, show_default=True, help=help_text)


def picture_option(help_text: str) -> Decorator:
    """Return the option ``--out``, which names a PNG file to draw; no work is done for another."""
    return click.option(
        "--out",
        type=click.Path(path_type=Path, dir_okay=False),
        metavar="FILE.png",
        callback=_check_picture,
        help=help_text,
    )


def _check_picture(_: click.Context, __: click.Parameter, out: Path | None) -> Path | None:
    if out is not None and out.suffix.lower() != ".png":
        raise UserError(
            f"the picture is a PNG file, --out names {out.name}; call it {out.stem}.png."
        )
    if out is not None and not out.parent.is_dir():
        raise UserError(f"the folder {out.parent} of the picture is not there; make it first.")
    return out


time_scale_option = number_option(
    "--time-scale", click.FloatRange(1, 1000), 1.0, "How much faster than real the emulators run."
)


def device_options(verb: Verb) -> Verb:
    """Add the options that choose the devices; the verb hands them to ``open_devices``."""
    return config_option(emulate_option(time_scale_option(verb)))


@contextmanager
def open_devices(
    config: Path, emulate: bool, time_scale: float, **plan: Any
) -> Iterator[tuple[Settings, Emulation | None]]:
    """Yield the settings to use, and the emulation if there is one.

    Args:
        config: Configuration file.
        emulate: Whether to run emulators of all that it names.
        time_scale: How many times faster than real they run.
        plan: Further arguments of ``rehearse``.

    Raises:
        UserError: The configuration has a mistake, or an emulator cannot start.
    """
    settings = read_settings(config)
    with ExitStack() as stack:
        stack.enter_context(print_notes())
        if not emulate:
            yield settings, None
            return
        click.echo(f"emulated, {time_scale:g} times as fast as real; no device is opened", err=True)
        rehearsal = stack.enter_context(rehearse(settings, time_scale=time_scale, **plan))
        yield rehearsal.settings, rehearsal.emulation


@contextmanager
def print_notes() -> Iterator[None]:
    """Print the notes of an error, of which only one sentence would be shown otherwise."""
    try:
        yield
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


def write_figures(path: Path | None, rows: Sequence[tuple[str, str, Any, str]]) -> None:
    """Write rows (metric, group, value, unit) to a file, if there is one."""
    if path is not None:
        keys = ("metric", "group", "value", "unit")
        write_json(path, [dict(zip(keys, row, strict=True)) for row in rows])


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
