"""Options that several verbs share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.completion import ENCODER, SENSOR

if TYPE_CHECKING:
    from tactibench.run import RunRequest

Verb = Callable[..., Any]


def output_file(
    *names: str, suffixes: tuple[str, ...] = (), **attributes: Any
) -> Callable[[Verb], Verb]:
    """Return an option that names a file to write.

    What could not be written after the work is refused before it: a folder that is not there, and
    a name that ends in none of the suffixes, the first of which is proposed.
    """

    def check(_ctx: click.Context, _option: click.Parameter, path: Path | None) -> Path | None:
        if path is None:
            return None
        if suffixes and path.suffix.lower() not in suffixes:
            kind = suffixes[0][1:].upper()
            raise click.BadParameter(
                f"{path.name} is no {kind} file; call it {path.stem}{suffixes[0]}."
            )
        if not path.parent.is_dir():
            raise click.BadParameter(f"the folder {path.parent} is not there; make it first.")
        return path

    file = click.Path(path_type=Path, dir_okay=False, writable=True)
    return click.option(*names, type=file, callback=check, **attributes)


def picture_file(name: str, help_text: str) -> Callable[[Verb], Verb]:
    """Return an option that names a picture to draw."""
    return output_file(name, suffixes=(".png",), metavar="FILE.png", help=help_text)


def folder_option(*names: str, default: str, help_text: str) -> Callable[[Verb], Verb]:
    """Return an option that names a folder, which need not be there."""
    folder = click.Path(path_type=Path, file_okay=False)
    return click.option(
        *names, type=folder, default=Path(default), show_default=True, help=help_text
    )


def param_option(
    metavar: str = "KIND.NAME=VALUE", help_text: str = "Set a parameter."
) -> Callable[[Verb], Verb]:
    """Return the option that sets a parameter of a plugin; the verb takes all as ``params``."""
    return click.option("--param", "params", multiple=True, metavar=metavar, help=help_text)


store_option = folder_option("--store", default="runs", help_text="The run store.")
board_option = folder_option(
    "--board", "board_folder", default="leaderboards", help_text="Folder of the leaderboards."
)
full_option = click.option("--full", is_flag=True, help="Print all tables and published rows.")
json_option = output_file("--json", "json_file", help="Write the results here, as JSON.")
picture_option = picture_file("--out", "Draw the picture.")


def save_json(path: Path | None, values: Any) -> None:
    """Write values as JSON where ``--json`` names a file."""
    if path is not None:
        from tactibench.records import write_json

        write_json(path, values)


def add_options(*options: Callable[[Verb], Verb]) -> Callable[[Verb], Verb]:
    """Return a decorator that adds several options, which ``--help`` lists in this order."""

    def decorate(verb: Verb) -> Verb:
        for option in reversed(options):
            verb = option(verb)
        return verb

    return decorate


def request_options(
    *,
    regime: str = "Frames handed to training; default: the protocol's first.",
    encoder: str = "Encoder, for models that use one.",
    seed: str | None = None,
) -> Callable[[Verb], Verb]:
    """Add what a request asks of frames, weights and machine; the arguments are help texts.

    The verb takes the values as ``**options`` and hands them to ``request_of``.
    """
    return add_options(
        click.option("--regime", help=regime),
        click.option(
            "--sensor", type=SENSOR, help="Sensor that makes the frames; default: the protocol's."
        ),
        click.option("--encoder", type=ENCODER, help=encoder),
        click.option("--data", type=click.Path(path_type=Path), help="Folder of recorded frames."),
        click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help=seed),
        click.option(
            "--device",
            type=click.Choice(["auto", "cpu", "cuda"]),
            default="auto",
            show_default=True,
        ),
        param_option(),
    )


def request_of(protocol: str, model: str, options: Mapping[str, Any], **more: Any) -> RunRequest:
    """Return the request of a verb with ``request_options``; more: further fields of it.

    Raises UserError for a ``--param`` that is not understood.
    """
    from tactibench.run import RunRequest, read_parameters

    fields = dict(options)
    return RunRequest(
        protocol, model, parameters=read_parameters(fields.pop("params")), **fields, **more
    )
