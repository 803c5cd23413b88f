"""Options that several verbs share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.completion import ENCODER, SENSOR

if TYPE_CHECKING:
    from tactibench.run.request import RunRequest

Verb = Callable[..., None]


def writable_place(_ctx: click.Context, _option: click.Parameter, path: Path | None) -> Path | None:
    """Refuse before the work what could not be written after it."""
    if path is not None and not path.parent.is_dir():
        raise click.BadParameter(f"the folder {path.parent} is not there; make it first.")
    return path


def picture(_ctx: click.Context, _option: click.Parameter, path: Path | None) -> Path | None:
    """A PNG file in a folder that is there."""
    if path is not None and path.suffix.lower() != ".png":
        raise click.BadParameter(f"{path.name} is no PNG file; call it {path.stem}.png.")
    return writable_place(_ctx, _option, path)


store_option = click.option(
    "--store",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("runs"),
    show_default=True,
    help="The run store.",
)
json_option = click.option(
    "--json",
    "json_file",
    type=click.Path(path_type=Path, dir_okay=False, writable=True),
    callback=writable_place,
    help="Write the record here.",
)
board_option = click.option(
    "--board",
    "board_folder",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("leaderboards"),
    show_default=True,
    help="Folder of the leaderboards.",
)
runs_option = click.option(
    "--store",
    "runs",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("runs"),
    show_default=True,
    help="The run store.",
)
picture_option = click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False, writable=True),
    callback=picture,
    metavar="FILE.png",
    help="Draw the picture.",
)
more_runs_option = click.option(
    "--store",
    "runs",
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    help="Take the complete runs of this store, too.",
)
one_sensor_option = click.option(
    "--sensor", help="Such as 'tactip-127, instance=1'; default: the nominal one."
)


def request_options(
    *,
    regime: str = "Frames handed to training; default: the protocol's first.",
    encoder: str = "Encoder, for models that use one.",
    seed: str | None = None,
) -> Callable[[Verb], Verb]:
    """Add what a request asks of frames, weights and machine; the arguments are help texts.

    The verb takes the values as ``**asked`` and hands them to ``request_of``.
    """
    options = (
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
        click.option(
            "--param", "params", multiple=True, metavar="KIND.NAME=VALUE", help="Set a parameter."
        ),
    )

    def decorate(verb: Verb) -> Verb:
        for option in reversed(options):
            verb = option(verb)
        return verb

    return decorate


def request_of(protocol: str, model: str, asked: Mapping[str, Any], **more: Any) -> RunRequest:
    """The request of a verb with ``request_options``; more: further fields of it.

    Raises UserError for a ``--param`` that is not understood.
    """
    from tactibench.run.request import RunRequest, read_parameters

    fields = dict(asked)
    return RunRequest(
        protocol, model, parameters=read_parameters(fields.pop("params")), **fields, **more
    )
