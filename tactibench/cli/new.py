"""``tactibench new``: write the first version of a plugin."""

from __future__ import annotations

from pathlib import Path

import click

from tactibench.cli.text import echo
from tactibench.plugins import KINDS

LIBRARIES = ("numpy", "torch", "sklearn")
EXAMPLES = {
    "model": "tactibench run exp1 --model {name} --quick",
    "sensor": "tactibench run exp1 --model nearest --sensor {name} --quick",
    "encoder": "tactibench run exp1 --model unet --encoder {name} --quick",
}


@click.command()
@click.argument("kind", type=click.Choice(KINDS))
@click.argument("name")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path(),
    help="Where to make the package's folder; default: here.",
)
@click.option(
    "--with",
    "library",
    type=click.Choice(LIBRARIES),
    default=LIBRARIES[0],
    show_default=True,
    help="What a model is made with.",
)
@click.option("--channels", is_flag=True, help="A sensor that gives numbers and no pictures.")
def new(kind: str, name: str, out: Path, library: str, channels: bool) -> None:
    """Write an installable package with a small, working model, sensor or encoder called NAME.

    The folder is called tactibench-NAME. Nothing that is there already is changed.
    """
    from tactibench.plugins import PluginHost
    from tactibench.scaffold import check_name, write_package

    if channels and kind != "sensor":
        raise click.UsageError(f"--channels is for a sensor, not for {kind!r}; leave it out.")
    if library != LIBRARIES[0] and kind != "model":
        raise click.UsageError(f"--with {library} is for a model, not for {kind!r}; leave it out.")
    names = check_name(kind, name, PluginHost())
    template = "skin" if channels else "" if library == LIBRARIES[0] else library
    folder = write_package(names, out, template)
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        echo(f"wrote {path}")
    place = folder if folder.is_absolute() else f"./{folder}"  # a bare name, pip would look up
    example = EXAMPLES[kind].format(name=name)
    echo("next:")
    for command in (f"pip install -e {place}", f"tactibench check {name}", example):
        echo(f"  {command}")
