"""``tactibench data info``: the content of a folder, and the protocols that it can serve."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.options import json_option, param_option, picture_file, save_json
from tactibench.errors import UserError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from tactibench.cli.output import Terminal
    from tactibench.datasets import ImportOptions, LabelReport, LabelSummary, PinSummary, Recording
    from tactibench.frames import Service

SHEET_ROWS, SHEET_COLUMNS = 6, 8
SHEET_INCHES = (10.2, 9.4)
_LONGEST_NAME = 20


@click.command(short_help="what a folder holds, and what it can serve")
@click.argument("folder", type=click.Path(path_type=Path))
@picture_file("--sheet", "Draw frames spread over the labels.")
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
        channel_ranges,
        describe_poses,
        label_values,
        open_recording,
        read_options,
        summarize_labels,
        summarize_pins,
    )
    from tactibench.frames.services import services

    terminal = Terminal()
    options = read_options(params)
    recording = open_recording(folder, options)
    if sheet is not None and isinstance(recording.kind, ChannelKind):
        raise UserError(f"{folder} holds {recording.kind} and no images; leave --sheet out.")
    labels = summarize_labels(label_values(recording))
    _print_facts(terminal, folder, recording)
    _print_labels(terminal, labels)
    pins = None if isinstance(recording.kind, ChannelKind) else summarize_pins(recording)
    if pins is not None:
        _print_pins(terminal, pins)
    else:
        low, high = channel_ranges(recording)
        terminal.say(
            f"\nchannels: {low.min():g} to {high.max():g}, each over at least "
            f"{(high - low).min():g}"
        )
    terminal.say("")
    report = _labels_report(recording, options)
    print_labels_report(terminal, report)
    if poses := describe_poses(recording.labels):
        terminal.say(f"  {poses}")
    protocols = services(recording, report.contradictions)
    _print_services(terminal, protocols)
    for note in recording.notes:
        terminal.say(f"note: {note}")
    if sheet is not None:
        draw_sheet(sheet, recording)
        terminal.say(f"picture: {sheet}")
    save_json(json_file, _rows(recording, labels, pins, protocols))


def _print_facts(terminal: Terminal, folder: Path, recording: Recording) -> None:
    from tactibench.report import print_table, table

    presses = len(set(recording.presses))
    rest = "none"
    if recording.rest is not None:
        rest = recording.rest.name
    elif recording.estimated_rest is not None:
        rest = "estimated"
    elif recording.rest_signal() is not None:
        rest = "there"
    known = sum(scene is not None for scene in recording.scenes)
    facts = [
        ("format", f"{recording.format} ({recording.generation})"),
        ("frames", f"{len(recording):,} of {recording.kind}, {presses:,} presses"),
        ("rest frame", rest),
        ("contacts", f"{known:,} frames" if known else "none, labels only"),
    ]
    if recording.dataset is not None:
        header = recording.dataset.header
        facts.insert(0, ("name", header.name))
        facts.append(("sensor", str(header.sensor.get("name", "unknown"))))
        facts.append(("licence", header.licence or "unknown"))
    if recording.about:
        facts.append(("says more", ", ".join(recording.about)))
    terminal.say(str(folder))
    print_table(terminal.out, table(("", ""), [(f"  {a}", b) for a, b in facts]))


def _print_labels(terminal: Terminal, labels: Sequence[LabelSummary]) -> None:
    from tactibench.report import Cell, Column, Head, Number, fixed, print_table, table

    changing = [label for label in labels if not label.constant]
    terminal.say("")
    if changing:
        names = ("least", "mean", "most")
        heads: list[Head] = ["label", *map(Column, names), "", "histogram"]
        rows: list[list[Cell]] = []
        for label in changing:
            values = (label.low, label.mean, label.high)
            numbers = (Number(value, fixed(2)) for value in values)
            rows.append([label.name, *numbers, label.unit, label.bars])
        print_table(terminal.out, table(heads, rows))
    same = [f"{label.name} {label.low:g}" for label in labels if label.constant]
    if same:
        terminal.say(f"the same in all frames: {', '.join(same)}")


def _labels_report(recording: Recording, options: ImportOptions) -> LabelReport:
    """Return what the frames say of the labels; labels of nothing known are taken as a plate's."""
    from tactibench.datasets import LabelReport, cached_report, plate_scenes

    scenes = recording.scenes
    if not any(scenes):
        try:
            scenes, _ = plate_scenes(recording, options)
        except UserError as error:
            return LabelReport(0, (f"no labels of a plate: {error}",))
    return cached_report(recording, scenes, options)


def print_labels_report(terminal: Terminal, report: LabelReport) -> None:
    """Show what the frames say of the labels."""
    terminal.say(f"labels held against {report.presses:,} frames")
    for fact in report.facts:
        terminal.say(f"  {fact}")
    for wrong in (*report.contradictions, *report.doubts):
        terminal.say(f"  WARNING: {wrong}")


def _print_services(terminal: Terminal, protocols: Sequence[Service]) -> None:
    """Show what the recording can serve; protocols with the same answer share a line."""
    terminal.say("\nprotocols")
    by_answer: dict[tuple[bool, str], list[str]] = {}
    for service in protocols:
        by_answer.setdefault((service.served, service.reason), []).append(service.protocol)
    for (served, reason), names in by_answer.items():
        terminal.say(f"  {'yes' if served else 'no':<4}{', '.join(names)}: {reason}")


def _print_pins(terminal: Terminal, pins: PinSummary) -> None:
    counts = sorted(pins.counts)
    median = counts[len(counts) // 2]
    count = f"{counts[0]}" if counts[0] == counts[-1] else f"{counts[0]} to {counts[-1]}"
    text = f"\npins in {pins.frames} frames: {count} found, {median} in the median"
    if pins.rest is not None:
        text += f"; {pins.rest} in the rest frame"
    if pins.visible_share is not None and pins.moved_px is not None:
        text += f", all of them seen in {pins.visible_share:.0%} of the frames, moved up to "
        text += f"{pins.moved_px:.1f} px in the median frame"
    terminal.say(text)


def _rows(
    recording: Recording,
    labels: Sequence[LabelSummary],
    pins: PinSummary | None,
    protocols: Sequence[Service],
) -> list[dict[str, Any]]:
    """Return rows of metric, group, value, unit."""

    def row(metric: str, group: str, value: Any, unit: str = "") -> dict[str, Any]:
        if isinstance(value, float) and not math.isfinite(value):
            value = None
        return {"metric": metric, "group": group, "value": value, "unit": unit}

    rows = [
        row("format", "all", recording.format),
        row("generation", "all", recording.generation),
        row("frames", "all", len(recording)),
        row("presses", "all", len(set(recording.presses))),
        *(row(name, "all", value, unit) for name, value, unit in _kind_facts(recording)),
        row("contacts known", "all", sum(s is not None for s in recording.scenes)),
        row("sha256", "all", recording.sha256),
    ]
    for label in labels:
        rows += [
            row("least", label.name, label.low, label.unit),
            row("mean", label.name, label.mean, label.unit),
            row("most", label.name, label.high, label.unit),
            row("histogram", label.name, list(label.counts), "frames"),
        ]
    if pins is not None:
        rows += [
            row("pins found, least", "all", min(pins.counts)),
            row("pins found, most", "all", max(pins.counts)),
            row("pins at rest", "all", pins.rest),
            row("all pins seen", "all", pins.visible_share, "share"),
            row("largest displacement, median", "all", pins.moved_px, "px"),
        ]
    rows += [
        row("served", service.protocol, service.served) | {"reason": service.reason}
        for service in protocols
    ]
    return rows + [row("note", "all", note) for note in recording.notes]


def _kind_facts(recording: Recording) -> list[tuple[str, Any, str]]:
    """Return name, value and unit of what the frames' signal is."""
    from tactibench.datasets import ChannelKind

    kind = recording.kind
    if isinstance(kind, ChannelKind):
        return [("signal", list(kind.shape), "")]
    return [
        ("height", kind.height, "px"),
        ("width", kind.width, "px"),
        ("channels", recording.channels, ""),
    ]


def draw_sheet(path: Path, recording: Recording) -> None:
    """Write a sheet of frames as PNG.

    From top to bottom the first label grows, along a row the second.
    """
    from tactibench.datasets import changing_labels, label_values, spread_rows, unit_of
    from tactibench.report import headline, new_figure, save_png

    labels = changing_labels(label_values(recording))
    rows = spread_rows(
        list(labels.values()), len(recording), SHEET_ROWS * SHEET_COLUMNS, SHEET_COLUMNS
    )
    sheet = new_figure(*SHEET_INCHES)
    panels = sheet.subplots(SHEET_ROWS, SHEET_COLUMNS, squeeze=False).ravel()
    for panel in panels:
        panel.set_axis_off()
    for panel, row in zip(panels, rows, strict=False):
        panel.imshow(recording.image(row), cmap="gray", vmin=0, vmax=255)
        panel.set_title(_caption(recording, labels, row), fontsize=6, pad=3)
    title = recording.folder.resolve().name
    if recording.dataset is not None:
        title = recording.dataset.header.name
    above = ", ".join(f"{name} {unit_of(name)}".strip() for name in labels) or "no labels"
    headline(
        sheet,
        f"{title}: {len(recording):,} frames of {recording.kind}",
        f"{len(rows)} of them, spread over the labels; above each: {above}",
    )
    save_png(sheet, path)


def _caption(recording: Recording, labels: Mapping[str, npt.NDArray[np.float64]], row: int) -> str:
    """Return two short lines: the labels that are shown, and the frame's name."""
    from tactibench.datasets import unit_of

    name = Path(recording.names[row]).name
    name = name if len(name) <= _LONGEST_NAME else f"…{name[1 - _LONGEST_NAME :]}"
    numbers = ", ".join(
        f"{column[row]:.1f}°" if unit_of(label) == "deg" else f"{column[row]:.2f}"
        for label, column in labels.items()
    )
    return f"{numbers}\n{name}" if numbers else name
