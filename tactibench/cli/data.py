"""``tactibench data``: data sets on the disk, their formats, and what they can serve."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.options import echo, json_option, output_file, param_option, save_json
from tactibench.errors import UserError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tactibench.cli.output import Terminal
    from tactibench.datasets import ImportOptions, LabelReport, Recording
    from tactibench.frames import Service

SHEET_ROWS, SHEET_COLUMNS = 6, 8
SHEET_INCHES = (10.2, 9.4)
SHOWN = 20
"""Findings that `verify` prints; --json has all."""


@click.group()
def data() -> None:
    """Data sets on the disk: read recordings, check, share and describe them."""


@data.command(short_help="write a data set as Parquet files")
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False, exists=True))
@click.argument("target", type=click.Path(path_type=Path))
@click.option(
    "--split", metavar="NAME", help="Its parts become files of their own; default: the only one."
)
@json_option
def export(folder: Path, target: Path, split: str | None, json_file: Path | None) -> None:
    """Write the data set in FOLDER as Parquet files to TARGET, as Hugging Face reads them.

    Images are inside the files (needs tactibench[hf]). TARGET must be new or empty: nothing is
    overwritten, and an interrupted export leaves nothing.
    """
    from tactibench.cli.output import Terminal
    from tactibench.datasets import export_dataset, open_dataset

    dataset = open_dataset(folder)
    terminal = Terminal()
    with terminal.task("export", len(dataset.samples)) as advance:
        export = export_dataset(dataset, target, split=split, advance=advance)
    subsets = ", ".join(f"{subset} {count:,}" for subset, count in export.subsets.items())
    bad = f"; {export.bad:,} marked bad left out" if export.bad else ""
    size = f"{export.size_bytes / 1e6:,.1f} MB"
    terminal.say(
        f"{export.path}: {sum(export.subsets.values()):,} samples ({subsets}){bad}; {size}"
    )
    rows = [_row("samples", subset, count) for subset, count in export.subsets.items()]
    rows += [_row("left_out", "bad", export.bad), _row("size", "all", export.size_bytes, "B")]
    save_json(json_file, rows)


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
    heads: list[Head] = ["", *map(Column, ("mm", "one sigma", "of scatter"))]
    lengths = (
        ("offset a", pivot.offset_mm, pivot.offset_std, pivot.offset_scatter),
        ("pivot p", pivot.pivot_mm, pivot.pivot_std, pivot.pivot_scatter),
        ("pivot beside the axis q", pivot.side_mm, pivot.side_std, None),
    )
    print_table(
        terminal.out,
        table(
            heads,
            [(n, *("" if v is None else f"{v:.3f}" for v in values)) for n, *values in lengths],
        ),
    )
    terminal.say(f"median misfit of the pins' spread: {pivot.residual:.1%}")
    if fit.shear:
        terminal.say(f"shear taken out: {', '.join(fit.shear)}")
    terminal.say(
        f"a positive tilt moves the contact towards {fit.lean_deg:.0f} deg of the frame "
        "(0: right, 90: down)"
    )
    params = " ".join(f"--param {name}={value}" for name, value in fit.options().items())
    terminal.say(f"\ntactibench data import {shlex.quote(str(folder))} TARGET {params}")
    rows = [_row(n, "all", value, "mm") | {"std": std} for n, value, std, _ in lengths]
    rows += [
        _row("lean", "all", fit.lean_deg, "deg"),
        _row("misfit", "all", pivot.residual, "share"),
        _row("presses", "all", pivot.presses),
        _row("presses left out", "all", pivot.left_out),
    ]
    save_json(json_file, rows)


@data.command(short_help="press a sensor and keep the frames")
@click.argument("what", metavar="PROTOCOL|PLAN.jsonl")
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
    what: str,
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
    tactibench data generate presses.jsonl --out data/grid
    """
    from tactibench.cli.output import Terminal
    from tactibench.datasets import generate as write
    from tactibench.datasets import is_complete, is_dataset, open_dataset, resolve_presses
    from tactibench.run import read_parameters

    parameters = read_parameters(params, ("sensor",)).get("sensor", {})
    press_plan, source = resolve_presses(what, sensor, parameters, count, seed)
    terminal = Terminal()
    total = sum(1 for _ in press_plan)
    if is_complete(out, source, press_plan):
        terminal.say(f"{out}: complete, {total:,} samples")
        return
    if is_dataset(out):
        there = len(open_dataset(out).samples)
        terminal.say(f"{out}: {there:,} of {total:,} samples are there, going on")
    with terminal.task("press", total) as advance:
        write(out, source, press_plan, advance)
    terminal.say(f"{out}: {total:,} samples of {source.identity['name']} written")


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
    params: tuple[str, ...],
    guess: bool,
    mapping: Path | None,
) -> None:
    """Read a folder of recorded frames into the new data set TARGET.

    SOURCE is a TacTip folder (targets.csv and frames) or a folder with a CSV file. Frames are
    checked and kept byte for byte. Labels become contacts where --param indenter says what pressed;
    `tactibench data fit SOURCE` finds a plate's offset_mm and pivot_mm.
    With --guess columns are found by their names and by the signal; read the file that it writes,
    correct it, and import again with --map.

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
    recording = open_recording(source, options)
    with terminal.task("import", len(recording)) as advance:
        dataset = read_into(recording, target, options, advance)
    known = sum(sample.scene is not None for sample in dataset.samples)
    places = f"named places {', '.join(recording.sites)}"
    unknown = places if recording.sites else "labels without contacts"
    what = f"{known:,} with contacts" if known else unknown
    terminal.say(f"{target}: {len(dataset.samples):,} frames of {recording.kind}, {what}")
    if recording.light:
        terminal.say(f"  light: {recording.light}")
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


@data.command(short_help="what a folder holds, and what it can serve")
@click.argument("folder", type=click.Path(path_type=Path))
@output_file(
    "--sheet", suffixes=(".png",), metavar="FILE.png", help="Draw frames spread over the labels."
)
@param_option("NAME=VALUE", "Say where labels are and what they mean, as `data import` does.")
@json_option
def info(folder: Path, sheet: Path | None, params: tuple[str, ...], json_file: Path | None) -> None:
    """Show what FOLDER holds: a recording of any known format, or a data set.

    \b
    tactibench data info recordings/331 --sheet frames.png
    """
    from tactibench.cli.output import Terminal
    from tactibench.datasets import (
        ChannelKind,
        label_ranges,
        open_recording,
        pin_counts,
        read_options,
    )
    from tactibench.frames import served_protocols

    terminal = Terminal()
    options = read_options(params)
    recording = open_recording(folder, options)
    channels = isinstance(recording.kind, ChannelKind)
    if sheet is not None and channels:
        raise UserError(f"{folder} holds {recording.kind} and no images; leave --sheet out.")
    labels = label_ranges(recording)
    _print_facts(terminal, folder, recording)
    _print_labels(terminal, labels)
    pins = None if channels else pin_counts(recording)
    if pins is not None:
        counts = sorted(pins[0])
        low, median, high = counts[0], counts[len(counts) // 2], counts[-1]
        rest = "" if pins[1] is None else f", {pins[1]} in the rest frame"
        terminal.say(f"\npins in {len(pins[0])} frames: {median} ({low} to {high}){rest}")
    report = _labels_report(recording, options)
    terminal.say("")
    print_labels_report(terminal, report)
    protocols = served_protocols(recording, report.contradictions)
    terminal.say("\nprotocols")
    answers = dict.fromkeys((service.served, service.reason) for service in protocols)
    for answer in answers:  # protocols with the same answer share a line
        names = [s.protocol for s in protocols if (s.served, s.reason) == answer]
        terminal.say(f"  {'yes' if answer[0] else 'no':<4}{', '.join(names)}: {answer[1]}")
    for note in recording.notes:
        terminal.say(f"note: {note}")
    if sheet is not None:
        draw_sheet(sheet, recording)
        terminal.say(f"picture: {sheet}")
    save_json(json_file, _info_rows(recording, labels, pins, protocols))


@data.command(short_help="how good is the sensor, before any model")
@click.argument("folder", type=click.Path(path_type=Path))
@output_file("--out", suffixes=(".html",), metavar="FILE.html", help="Write a page, too.")
@param_option("NAME=VALUE", "Say where labels are and what they mean, as `data import` does.")
@json_option
def report(folder: Path, out: Path | None, params: tuple[str, ...], json_file: Path | None) -> None:
    """Show how good the sensor of FOLDER is: a recording of any known format, or a data set.

    Pins or channels, noise, repeatability, drift, hysteresis, the smallest press, what is dead,
    saturated or frozen, the best that any model could do, and what limits it.

    \b
    tactibench data report recordings/331 --out sensor.html
    """
    from tactibench.cli.output import Terminal
    from tactibench.datasets import open_recording, read_options, report_sensor
    from tactibench.records import atomic
    from tactibench.report import print_table, sensor_page, sensor_table

    terminal = Terminal()
    options = read_options(params)
    recording = open_recording(folder, options)
    with terminal.task("follow pins", len(recording)) as advance:
        found = report_sensor(recording, options, advance)
    facts = f"{len(recording):,} frames of {recording.kind}"
    terminal.say(f"{folder}: {facts}")
    print_table(terminal.out, sensor_table(found))
    print_labels_report(terminal, _labels_report(recording, options))
    terminal.say(found.limit)
    if out is not None:
        with atomic(out) as stream:
            stream.write(sensor_page(found, folder.resolve().name, facts).encode())
        terminal.say(f"page: {out}")
    rows = [_row(m.name, "all", m.value, m.unit) | {"remark": m.remark} for m in found.measures]
    save_json(json_file, [*rows, _row("limit", "all", found.limit)])


def _print_facts(terminal: Terminal, folder: Path, recording: Recording) -> None:
    presses = len(set(recording.presses))
    known = sum(scene is not None for scene in recording.scenes)
    facts = {
        "format": f"{recording.format} ({recording.generation})",
        "frames": f"{len(recording):,} of {recording.kind}, {presses:,} presses",
        "rest frame": recording.rest_name or "none",
        **({"light": recording.light} if recording.light else {}),
        "contacts": f"{known:,} frames" if known else "none, labels only",
    }
    if recording.dataset is not None:
        header = recording.dataset.header
        facts["name"] = header.name
        facts["sensor"] = str(header.sensor.get("name", "unknown"))
        facts["licence"] = header.licence or "unknown"
    if recording.about:
        facts["says more"] = ", ".join(recording.about)
    terminal.say(str(folder))
    for name, text in facts.items():
        terminal.say(f"  {name:<11}{text}")


def _print_labels(terminal: Terminal, labels: Mapping[str, tuple[float, ...]]) -> None:
    from tactibench.datasets import unit_of
    from tactibench.report import Cell, Column, Head, Number, fixed, print_table, table

    heads: list[Head] = ["label", *map(Column, ("least", "mean", "most")), ""]
    rows: list[list[Cell]] = [
        [name, *(Number(value, fixed(2)) for value in numbers), unit_of(name)]
        for name, numbers in labels.items()
    ]
    terminal.say("")
    print_table(terminal.out, table(heads, rows))


def _labels_report(recording: Recording, options: ImportOptions) -> LabelReport:
    """Return what the frames say of the labels; labels of nothing known are taken as a plate's."""
    from tactibench.datasets import LabelReport, cached_report

    scenes = recording.scenes
    if recording.sites:
        return LabelReport(0, ("named places have no coordinates to hold against the channels",))
    if not any(scenes):
        try:
            scenes, _ = recording.plate_scenes(options)
        except UserError as error:
            return LabelReport(0, (f"no labels of a plate: {error}",))
    return cached_report(recording, scenes, options)


def print_labels_report(terminal: Terminal, report: LabelReport) -> None:
    """Show what the frames say of the labels."""
    terminal.say(f"labels held against {report.presses:,} frames")
    for fact in report.facts:
        terminal.say(f"  {fact}")
    for wrong in report.contradictions:
        terminal.say(f"  WARNING: {wrong}")


def _info_rows(
    recording: Recording,
    labels: Mapping[str, tuple[float, ...]],
    pins: tuple[list[int], int | None] | None,
    protocols: Sequence[Service],
) -> list[dict[str, Any]]:
    """Return rows of metric, group, value, unit."""
    from tactibench.datasets import unit_of

    facts = {
        "format": recording.format,
        "generation": recording.generation,
        "frames": len(recording),
        "presses": len(set(recording.presses)),
        "shape": list(recording.kind.shape),
        "contacts known": sum(scene is not None for scene in recording.scenes),
        "sha256": recording.sha256,
    }
    if pins is not None:
        facts |= {
            "pins found, least": min(pins[0]),
            "pins found, most": max(pins[0]),
            "pins at rest": pins[1],
        }
    rows = [_row(name, "all", value) for name, value in facts.items()]
    for name, numbers in labels.items():
        words = zip(("least", "mean", "most"), numbers, strict=True)
        rows += [_row(word, name, value, unit_of(name)) for word, value in words]
    rows += [_row("served", s.protocol, s.served) | {"reason": s.reason} for s in protocols]
    return rows + [_row("note", "all", note) for note in recording.notes]


def draw_sheet(path: Path, recording: Recording) -> None:
    """Write a sheet of frames as PNG; from first to last the first label grows."""
    from tactibench.report import in_own_style, save_png

    save_png(in_own_style(_sheet_figure)(recording), path)


def _sheet_figure(recording: Recording) -> Figure:
    from tactibench.datasets import label_values, spread_rows, unit_of
    from tactibench.report import headline, new_figure

    values = label_values(recording)
    labels, rows = spread_rows(values, len(recording), SHEET_ROWS * SHEET_COLUMNS)
    sheet = new_figure(*SHEET_INCHES)
    panels = sheet.subplots(SHEET_ROWS, SHEET_COLUMNS, squeeze=False).ravel()
    for panel in panels:
        panel.set_axis_off()
    for panel, row in zip(panels, rows, strict=False):
        panel.imshow(recording.image(row), cmap="gray", vmin=0, vmax=255)
        numbers = ", ".join(f"{values[label][row]:.2f}" for label in labels)
        panel.set_title(f"{numbers}\n{recording.names[row][-20:]}", fontsize=6, pad=3)
    title = recording.folder.resolve().name
    above = ", ".join(f"{label} {unit_of(label)}".strip() for label in labels) or "no labels"
    headline(
        sheet,
        f"{title}: {len(recording):,} frames of {recording.kind}",
        f"{len(rows)} of them, spread over the labels; above each: {above}",
    )
    return sheet


def _row(metric: str, group: str, value: Any, unit: str = "") -> dict[str, Any]:
    if isinstance(value, float) and not math.isfinite(value):
        value = None
    return {"metric": metric, "group": group, "value": value, "unit": unit}
