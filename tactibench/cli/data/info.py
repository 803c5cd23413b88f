"""``tactibench data info``: what a folder holds, and what it can serve."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.options import json_option, picture

if TYPE_CHECKING:
    from tactibench.cli.output import Terminal
    from tactibench.datasets.describing.labels import Label
    from tactibench.datasets.describing.pins import Pins
    from tactibench.datasets.importing import Recording
    from tactibench.frames.services import Service


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--sheet",
    type=click.Path(path_type=Path, dir_okay=False, writable=True),
    callback=picture,
    metavar="FILE.png",
    help="Draw frames spread over the labels.",
)
@json_option
def info(folder: Path, sheet: Path | None, json_file: Path | None) -> None:
    """Show what FOLDER holds: a recording of any known format, or a data set.

    \b
    tactibench data info recordings/331 --sheet frames.png
    """
    from tactibench.cli.output import Terminal
    from tactibench.datasets.describing.labels import describe_labels, known_values
    from tactibench.datasets.describing.pins import count_pins
    from tactibench.datasets.importing import open_recording
    from tactibench.frames.services import services
    from tactibench.records.files import write_json

    terminal = Terminal()
    recording = open_recording(folder)
    labels = describe_labels(known_values(recording))
    _facts(terminal, folder, recording)
    _labels(terminal, labels)
    pins = count_pins(recording)
    _pins(terminal, pins)
    served = services(recording)
    _served(terminal, served)
    for note in recording.notes:
        terminal.say(f"note: {note}")
    if sheet is not None:
        from tactibench.datasets.describing.sheet import draw_sheet

        draw_sheet(sheet, recording)
        terminal.say(f"picture: {sheet}")
    if json_file is not None:
        write_json(json_file, _rows(recording, labels, pins, served))


def _facts(terminal: Terminal, folder: Path, recording: Recording) -> None:
    from tactibench.cli.report.cells import print_grid

    presses = len(set(recording.presses))
    rest = "none"
    if recording.rest is not None:
        rest = recording.rest.name
    elif recording.dataset is not None and recording.rest_image() is not None:
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
    print_grid(terminal.out, ("", ""), [(f"  {a}", b) for a, b in facts], show_heads=False)


def _labels(terminal: Terminal, labels: list[Label]) -> None:
    from tactibench.cli.report.cells import print_grid

    changing = [label for label in labels if not label.constant]
    terminal.say("")
    if changing:
        print_grid(
            terminal.out,
            ("label", "least", "mean", "most", "", "histogram"),
            [
                (
                    one.name,
                    f"{one.low:.2f}",
                    f"{one.mean:.2f}",
                    f"{one.high:.2f}",
                    one.unit,
                    one.bars,
                )
                for one in changing
            ],
            right=frozenset({"least", "mean", "most"}),
        )
    same = [f"{one.name} {one.low:g}" for one in labels if one.constant]
    if same:
        terminal.say(f"the same in all frames: {', '.join(same)}")


def _pins(terminal: Terminal, pins: Pins) -> None:
    found = sorted(pins.found)
    middle = found[len(found) // 2]
    count = f"{found[0]}" if found[0] == found[-1] else f"{found[0]} to {found[-1]}"
    text = f"\npins in {pins.frames} frames: {count} found, {middle} in the median"
    if pins.rest is not None:
        text += f"; {pins.rest} in the rest frame"
    if pins.followed is not None and pins.moved is not None:
        text += f", all of them seen in {pins.followed:.0%} of the frames, moved up to "
        text += f"{pins.moved:.1f} px in the median frame"
    terminal.say(text)


def _served(terminal: Terminal, served: list[Service]) -> None:
    terminal.say("\nprotocols")
    for one in served:
        terminal.say(f"  {one.protocol:<10} {'yes' if one.served else 'no ':<4} {one.reason}")


def _rows(
    recording: Recording, labels: list[Label], pins: Pins, served: list[Service]
) -> list[dict[str, Any]]:
    """Rows of metric, group, value, unit."""

    def row(metric: str, group: str, value: Any, unit: str = "") -> dict[str, Any]:
        return {"metric": metric, "group": group, "value": value, "unit": unit}

    rows = [
        row("format", "all", recording.format),
        row("generation", "all", recording.generation),
        row("frames", "all", len(recording)),
        row("presses", "all", len(set(recording.presses))),
        row("height", "all", recording.kind.height, "px"),
        row("width", "all", recording.kind.width, "px"),
        row("channels", "all", recording.channels),
        row("contacts known", "all", sum(s is not None for s in recording.scenes)),
        row("sha256", "all", recording.sha256),
    ]
    for label in labels:
        for metric, value in (("least", label.low), ("mean", label.mean), ("most", label.high)):
            rows.append(row(metric, label.name, value, label.unit))
        rows.append(row("histogram", label.name, list(label.counts), "frames"))
    rows += [
        row("pins found, least", "all", min(pins.found)),
        row("pins found, most", "all", max(pins.found)),
        row("pins at rest", "all", pins.rest),
        row("all pins seen", "all", pins.followed, "share"),
        row("largest displacement, median", "all", pins.moved, "px"),
    ]
    rows += [row("served", one.protocol, one.served) | {"reason": one.reason} for one in served]
    rows += [row("note", "all", note) for note in recording.notes]
    finite = (isinstance(r["value"], float) and not math.isfinite(r["value"]) for r in rows)
    return [{**r, "value": None} if bad else r for r, bad in zip(rows, finite, strict=True)]
