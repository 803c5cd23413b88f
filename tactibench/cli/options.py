"""Options that several verbs share."""

from __future__ import annotations

from pathlib import Path

import click


def _writable_place(
    _ctx: click.Context, _option: click.Parameter, path: Path | None
) -> Path | None:
    """Refuse before the work what could not be written after it."""
    if path is not None and not path.parent.is_dir():
        raise click.BadParameter(f"the folder {path.parent} is not there; make it first.")
    return path


def _picture(_ctx: click.Context, _option: click.Parameter, path: Path | None) -> Path | None:
    """A PNG file in a folder that is there."""
    if path is not None and path.suffix.lower() != ".png":
        raise click.BadParameter(f"{path.name} is no PNG file; call it {path.stem}.png.")
    return _writable_place(_ctx, _option, path)


out_option = click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("runs"),
    show_default=True,
    help="The run store.",
)
json_option = click.option(
    "--json",
    "json_file",
    type=click.Path(path_type=Path, dir_okay=False, writable=True),
    callback=_writable_place,
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
    "--runs",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("runs"),
    show_default=True,
    help="The run store.",
)
picture_option = click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False, writable=True),
    callback=_picture,
    metavar="FILE.png",
    help="Draw the picture.",
)
