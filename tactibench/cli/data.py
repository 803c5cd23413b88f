"""``tactibench data``: data sets on the disk, from and to other formats."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.data_info import info, print_labels_report
from tactibench.cli.options import json_option, param_option, save_json
from tactibench.cli.text import echo

if TYPE_CHECKING:
    from tactibench.cli.output import Terminal
    from tactibench.datasets import Export

FORMATS = ("bristol", "card", "hf-parquet")
"""Those of the exporter, written out: to read them there would load numpy for a help text."""
SHOWN = 20
"""Findings that `verify` prints; --json has all."""


@click.group()
def data() -> None:
    """Data sets on the disk: read recordings, check, share and describe them."""


data.add_command(info)


@data.command(short_help="write a data set in another format")
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
    bristol     sensor_images/, targets.csv, *_params.json; `data import` reads it back
    hf-parquet  Parquet files with the images inside (needs tactibench[hf])
    card        README.md, as the Hugging Face Hub reads it

    TARGET must be new or empty: nothing is overwritten, and an interrupted export leaves nothing.
    """
    from tactibench.cli.output import Terminal
    from tactibench.datasets import export_dataset, open_dataset

    dataset = open_dataset(folder)
    terminal = Terminal()
    with terminal.task(f"export {format_}", len(dataset.samples)) as advance:
        summary = export_dataset(dataset, target, format_, split=split, advance=advance)
    for sentence in dataset.repaired:
        terminal.say(f"{folder}: {sentence}")
    terminal.say(_export_line(summary))
    save_json(json_file, _export_rows(summary))


def _export_line(export: Export) -> str:
    subsets = ", ".join(f"{subset} {count:,}" for subset, count in export.subsets.items())
    bad = f"; {export.bad:,} marked bad left out" if export.bad else ""
    return (
        f"{export.path}: {export.samples:,} samples{f' ({subsets})' if subsets else ''}{bad}; "
        f"{export.files:,} file{'' if export.files == 1 else 's'}, "
        f"{export.size_bytes / 1e6:,.1f} MB"
    )


def _export_rows(export: Export) -> list[dict[str, Any]]:
    return [
        _row("samples", "all", export.samples),
        *(_row("samples", subset, count) for subset, count in export.subsets.items()),
        _row("left_out", "bad", export.bad),
        _row("files", "all", export.files),
        _row("size", "all", export.size_bytes, "B"),
    ]


@data.command(short_help="fit the geometry behind the labels of a recording")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--depth",
    default="auto",
    metavar="COLUMN",
    help="Depth label, mm, larger is deeper (-COLUMN: smaller is deeper); default: pose_2.",
)
@click.option("--tilt", default="auto", metavar="COLUMN", help="Tilt label, deg; default: pose_6.")
@json_option
def fit(folder: Path, depth: str, tilt: str, json_file: Path | None) -> None:
    """Fit indentation = depth label + a + p (1 - cos tilt) + q sin tilt to the pins of FOLDER.

    A robot counts depth from a pose, not from first touch, and turns the sensor about a point that
    is not the dome's centre. Pins are followed in the least sheared presses of a flat plate; their
    spread must vanish where the indentation does, at all tilts. A warning says where the pins
    contradict the labels.

    \b
    tactibench data fit recordings/331
    """
    from tactibench.cli.output import Terminal
    from tactibench.datasets import ImportOptions, fit_recording, open_recording, presses_to_fit
    from tactibench.report import Column, Head, print_table, table

    terminal = Terminal()
    recording = open_recording(folder)
    with terminal.task("follow pins", presses_to_fit(recording)) as advance:
        fit = fit_recording(recording, ImportOptions(depth=depth, tilt=tilt), advance)
    pivot, columns = fit.pivot, fit.columns
    terminal.say(
        f"indentation = {columns['depth']} + a + p (1 - cos {columns['tilt']}) + "
        f"q sin {columns['tilt']}, from "
        f"{fit.pins} pins in {pivot.presses:,} of {len(recording):,} presses"
    )
    contradiction = fit.contradiction()
    if contradiction:
        terminal.say(f"WARNING: {contradiction}; these labels give no indentation")
    offset = (f"{pivot.offset_mm:.3f}", f"{pivot.offset_std:.3f}", f"{pivot.offset_scatter:.3f}")
    turn = (f"{pivot.pivot_mm:.2f}", f"{pivot.pivot_std:.2f}", f"{pivot.pivot_scatter:.2f}")
    side = (f"{pivot.side_mm:.2f}", f"{pivot.side_std:.2f}", "")
    heads: list[Head] = ["", *map(Column, ("mm", "one sigma", "of scatter"))]
    print_table(terminal.out, table(heads, [("a", *offset), ("p", *turn), ("q", *side)]))
    terminal.say(f"median misfit of the pins' spread: {pivot.residual:.1%}")
    if fit.shear:
        terminal.say(f"shear taken out: {', '.join(fit.shear)}")
    terminal.say(
        f"a positive tilt moves the contact towards {fit.lean_deg:.0f} deg of the frame "
        "(0: right, 90: down)"
    )
    params = " ".join(f"--param {name}={value}" for name, value in fit.options().items())
    terminal.say(f"\ntactibench data import {shlex.quote(str(folder))} TARGET {params}")
    rows = [
        _row("offset", "all", pivot.offset_mm, "mm") | {"std": pivot.offset_std},
        _row("pivot", "all", pivot.pivot_mm, "mm") | {"std": pivot.pivot_std},
        _row("pivot beside the axis", "all", pivot.side_mm, "mm") | {"std": pivot.side_std},
        _row("lean", "all", fit.lean_deg, "deg") | {"std": None},
        _row("misfit", "all", pivot.residual, "share") | {"std": None},
        _row("presses", "all", pivot.presses) | {"std": None},
        _row("presses left out", "all", pivot.left_out) | {"std": None},
    ]
    save_json(json_file, rows)


@data.command(short_help="press a sensor and keep the frames")
@click.argument("protocol", required=False)
@click.option("--plan", type=click.Path(path_type=Path), help="Press the lines of a plan.jsonl.")
@click.option("--sensor", help="Sensor that is pressed; default: the protocol's.")
@param_option("sensor.NAME=VALUE", "Set one.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    metavar="DIR",
    help="Folder of the data set.",
)
@click.option("--count", type=click.IntRange(min=1), help="At most so many presses of every set.")
@click.option("--seed", type=click.IntRange(min=0), help="Other presses and other noise.")
def generate(
    protocol: str | None,
    plan: Path | None,
    sensor: str | None,
    params: tuple[str, ...],
    out: Path,
    count: int | None,
    seed: int | None,
) -> None:
    """Press a sensor as a protocol or a plan says, and write the frames as a data set.

    Of a protocol everything is pressed that it trains, validates and tests on, in all regimes; the
    frames are those of `tactibench run`, and every regime becomes a split. When it is interrupted,
    the same command continues.

    \b
    tactibench data generate exp1 --out data/exp1
    tactibench data generate exp2 --sensor tactip-331 --count 200 --out data/exp2-331
    tactibench data generate --plan presses.jsonl --out data/grid
    """
    from tactibench.cli.output import Terminal
    from tactibench.datasets import GenerationRequest, is_complete, is_dataset, sensor_parameters
    from tactibench.datasets import generate as write
    from tactibench.run import read_parameters

    parameters = sensor_parameters(read_parameters(params))
    request = GenerationRequest(protocol, plan, sensor, parameters, count, seed)
    press_plan, source = request.resolve()
    terminal = Terminal()
    total = sum(1 for _ in press_plan)
    if is_complete(out, source, press_plan):
        terminal.say(f"{out}: complete, {total:,} samples")
        return
    if is_dataset(out):
        _say_begun(terminal, out, total)
    with terminal.task("press", total) as advance:
        write(out, source, press_plan, advance)
    terminal.say(f"{out}: {total:,} samples of {source.identity['name']} written")


def _say_begun(terminal: Terminal, out: Path, total: int) -> None:
    from tactibench.datasets import open_dataset

    dataset = open_dataset(out)
    for sentence in dataset.repaired:
        terminal.say(f"{out}: {sentence}")
    if dataset.header.status == "open":
        terminal.say(f"{out}: {len(dataset.samples):,} of {total:,} samples are there, going on")


def _show_parameters(ctx: click.Context, _option: click.Parameter, wanted: bool) -> None:
    """List the parameters of an import, and end."""
    if not wanted:
        return
    from tactibench.datasets import PARAMETERS

    for parameter in PARAMETERS:
        default = f" [{parameter.default}]" if parameter.default != "" else ""
        choices = f" ({', '.join(map(str, parameter.choices))})" if parameter.choices else ""
        echo(f"  {parameter.name:<15} {parameter.help}{choices}{default}")
    ctx.exit()


@data.command("import", short_help="read a recording into a data set")
@click.argument("source", type=click.Path(path_type=Path))
@click.argument("target", type=click.Path(path_type=Path))
@click.option(
    "--format",
    "format_",
    metavar="NAME",
    help="bristol, csv or huggingface; default: what the folder looks like.",
)
@param_option("NAME=VALUE", "Say where labels are and what they mean; --params lists them.")
@click.option(
    "--params",
    "list_params",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_show_parameters,
    help="List what --param can set.",
)
@click.option(
    "--guess", is_flag=True, help="Guess the columns, and write the guess to TARGET.toml."
)
@click.option(
    "--map",
    "mapping",
    type=click.Path(path_type=Path, dir_okay=False, exists=True),
    help="Read the parameters from this file, as --guess wrote it.",
)
def import_folder(
    source: Path,
    target: Path,
    format_: str | None,
    params: tuple[str, ...],
    guess: bool,
    mapping: Path | None,
) -> None:
    """Read a folder of recorded frames into the new data set TARGET.

    SOURCE is a Bristol folder (targets.csv and frames), a folder with a CSV file, or a Hugging Face
    image folder. Frames are checked and kept byte for byte. Labels become contacts where --param
    indenter says what pressed; `tactibench data fit SOURCE` finds a plate's offset_mm and pivot_mm.
    With --guess columns are recognised by their names; read the file that it writes, correct it,
    and import again with --map.

    \b
    tactibench data import lab sets/lab --guess
    tactibench data import recordings/331 sets/331
    tactibench data import recordings/331 sets/331 --param indenter=plate --param offset_mm=5.05
    """
    from tactibench.cli.output import Terminal
    from tactibench.datasets import (
        cached_report,
        guess_mapping,
        open_recording,
        read_mapping,
        read_options,
        write_mapping,
    )
    from tactibench.datasets import import_folder as read_into

    terminal = Terminal()
    if guess and mapping:
        raise click.UsageError("--guess and --map cannot be used together; give one of them.")
    if guess:
        mapping = target.with_name(f"{target.name}.toml")
        guessed = guess_mapping(source, params)
        write_mapping(mapping, guessed)
        terminal.say(f"guessed, in {mapping}:")
        for line in guessed.text().splitlines()[2:]:
            terminal.say(f"  {line}")
    options = read_options(params) if mapping is None else read_mapping(mapping, params)
    recording = open_recording(source, options, format_)
    with terminal.task("import", len(recording)) as advance:
        dataset = read_into(recording, target, options, advance)
    known = sum(sample.scene is not None for sample in dataset.samples)
    what = f"{known:,} with contacts" if known else "labels without contacts"
    terminal.say(f"{target}: {len(dataset.samples):,} frames of {recording.kind}, {what}")
    for note in recording.notes:
        terminal.say(f"  note: {note}")
    if known:
        print_labels_report(terminal, cached_report(recording, recording.scenes, options))


@data.command(short_help="check every frame of a data set")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path, file_okay=False))
@json_option
@click.pass_context
def verify(ctx: click.Context, folder: Path, json_file: Path | None) -> None:
    """Read, hash and decode every image of a data set, and check its journals, plan and splits.

    Nothing is changed. Exit code 1 when something is not as it was written.
    """
    from tactibench.cli.output import Terminal
    from tactibench.datasets import count_samples
    from tactibench.datasets import verify as check

    terminal = Terminal()
    count = count_samples(folder)
    with terminal.task("verify", count) as advance:
        findings = check(folder, advance)
    for finding in findings[:SHOWN]:
        terminal.say(finding)
    if len(findings) > SHOWN:
        terminal.say(f"... and {len(findings) - SHOWN:,} more; --json FILE has all of them")
    verdict = f"{len(findings):,} findings" if findings else "all as it was written"
    terminal.say(f"{folder}: {count:,} samples, {verdict}")
    rows = [
        _row("samples", "all", count, "samples"),
        _row("findings", "all", len(findings), "findings"),
    ]
    save_json(json_file, {"findings": findings, "metrics": rows})
    if findings:
        ctx.exit(1)


def _row(metric: str, group: str, value: Any, unit: str = "") -> dict[str, Any]:
    return {"metric": metric, "group": group, "value": value, "unit": unit}
