"""``tactibench data export``: a data set in another format."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.options import json_option

if TYPE_CHECKING:
    from tactibench.datasets.exporting import Exported

FORMATS = ("bristol", "card", "croissant", "hf-parquet", "webdataset")
"""Those of the exporters, written out: to read them there would load numpy for a help text."""


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False, exists=True))
@click.argument("target", type=click.Path(path_type=Path))
@click.option("--format", "format_", type=click.Choice(FORMATS), required=True)
@click.option(
    "--split", metavar="NAME", help="Its parts become files of their own; default: the only one."
)
@json_option
def export(
    folder: Path, target: Path, format_: str, split: str | None, json_file: Path | None
) -> None:
    """Write the data set in FOLDER to TARGET, in another format.

    \b
    bristol     sensor_images/, targets.csv, *_params.json
    hf-parquet  Parquet files with the images inside (needs tactibench[hf])
    webdataset  tar files of PNG and JSON
    card        README.md, as the Hugging Face Hub reads it
    croissant   croissant.json, for catalogues; TARGET is FOLDER itself

    TARGET must be new or empty: nothing is overwritten, and an interrupted export leaves nothing.
    """
    from tactibench.cli.output import Terminal
    from tactibench.datasets import open_dataset
    from tactibench.datasets.exporting import export as write
    from tactibench.records.files import write_json

    dataset = open_dataset(folder)
    terminal = Terminal()
    with terminal.task(f"export {format_}", len(dataset.samples)) as advance:
        made = write(dataset, target, format_, split=split, advance=advance)
    for sentence in dataset.repaired:
        terminal.say(f"{folder}: {sentence}")
    terminal.say(_summary(made))
    if json_file is not None:
        write_json(json_file, _rows(made))


def _summary(made: Exported) -> str:
    parts = ", ".join(f"{part} {count:,}" for part, count in made.parts.items())
    bad = f"; {made.bad:,} marked bad left out" if made.bad else ""
    return (
        f"{made.path}: {made.samples:,} samples{f' ({parts})' if parts else ''}{bad}; "
        f"{made.files:,} file{'' if made.files == 1 else 's'}, {made.size_bytes / 1e6:,.1f} MB"
    )


def _rows(made: Exported) -> list[dict[str, Any]]:
    counts: list[tuple[str, str, int, str]] = [
        ("samples", "all", made.samples, ""),
        *(("samples", part, count, "") for part, count in made.parts.items()),
        ("left_out", "bad", made.bad, ""),
        ("files", "all", made.files, ""),
        ("size", "all", made.size_bytes, "B"),
    ]
    return [
        {"metric": metric, "group": group, "value": value, "unit": unit}
        for metric, group, value, unit in counts
    ]
