"""``tactibench data import``: a recording of another format into a data set."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("import")
@click.argument("source", type=click.Path(path_type=Path))
@click.argument("target", type=click.Path(path_type=Path))
@click.option(
    "--format",
    "format_",
    metavar="NAME",
    help="bristol, csv or huggingface; default: what the folder looks like.",
)
@click.option(
    "--param",
    "params",
    multiple=True,
    metavar="NAME=VALUE",
    help="Say where labels are and what they mean; --params lists them.",
)
@click.option(
    "--params",
    "show",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=lambda ctx, _option, wanted: _show(ctx) if wanted else None,
    help="List what --param can set.",
)
def import_folder(source: Path, target: Path, format_: str | None, params: tuple[str, ...]) -> None:
    """Read a folder of recorded frames into the new data set TARGET.

    SOURCE is a Bristol folder (targets.csv and frames), a folder with a CSV file, or a Hugging Face
    image folder. Frames are checked and kept byte for byte. Labels become contacts where --param
    indenter says what pressed; `tactibench data fit SOURCE` finds a plate's offset_mm and pivot_mm.

    \b
    tactibench data import recordings/331 sets/331
    tactibench data import recordings/331 sets/331 --param indenter=plate --param offset_mm=5.05
    """
    from tactibench.cli.output import Terminal
    from tactibench.datasets.importing import import_folder as carry_out
    from tactibench.datasets.importing import open_recording, read_options

    options = read_options(params)
    terminal = Terminal()
    recording = open_recording(source, options, format_)
    with terminal.task("import", len(recording)) as advance:
        dataset = carry_out(recording, target, options, advance)
    known = sum(sample.scene is not None for sample in dataset.samples)
    what = f"{known:,} with contacts" if known else "labels without contacts"
    terminal.say(f"{target}: {len(dataset.samples):,} frames of {recording.kind}, {what}")
    for note in recording.notes:
        terminal.say(f"  note: {note}")


def _show(ctx: click.Context) -> None:
    from tactibench.datasets.importing import PARAMETERS

    for parameter in PARAMETERS:
        default = f" [{parameter.default}]" if parameter.default != "" else ""
        choices = f" ({', '.join(map(str, parameter.choices))})" if parameter.choices else ""
        click.echo(f"  {parameter.name:<15} {parameter.help}{choices}{default}")
    ctx.exit()
