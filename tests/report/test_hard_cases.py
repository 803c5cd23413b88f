"""Hard cases on a page, in a picture and in a terminal: doubling points, errors, failures."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from rich.console import Console

from tactibench.board import rows_of
from tactibench.protocols import load_protocol
from tactibench.records import Cause, Failures, Metric, Record
from tactibench.report import (
    board_page,
    doubling_table,
    print_run,
    stability_figure,
)

PROTOCOL = load_protocol("stability")
AXES = PROTOCOL.spec.axes


def metric(name: str, group: str, value: float | None, **more: Any) -> Metric:
    ends = (
        {"low": None, "high": None} if value is None else {"low": 0.9 * value, "high": 1.1 * value}
    )
    unit = {"missed": "share", "ospa_mm": "mm"}.get(name, "")
    values = {**ends, "n": 50, "clusters": 50, "unit": unit, "better": "lower", **more}
    return Metric(metric=name, group=group, value=value, **values)


def record(
    fabricate: Any,
    model: str = "unet",
    scale: float = 1.0,
    doubles: dict[str, float] | None = None,
    **more: Any,
) -> Record:
    """Errors that grow along every axis; families double at their first value, or never."""
    made = fabricate("stability", model, encoder=None, error=scale, speed=[], **more)
    for axis in AXES:
        groups = ((axis.reference,) if axis.reference else ()) + axis.groups
        for k, group in enumerate(groups):
            made.metrics += [
                metric("ospa_mm", group, scale * 0.1 * (k + 1)),
                metric("missed", group, 0.05 * k),
                metric("spurious", group, 0.0),
            ]
            if axis.reference and k:
                made.metrics.append(metric("error_ratio", group, float(k + 1)))
        if axis.ordered and axis.family == "deep":
            made.metrics.append(metric("doubles_at", "deep", 6.5, censored=">"))
        elif axis.ordered:
            at = (doubles or {}).get(axis.family, axis.values[0])
            made.metrics.append(metric("doubles_at", axis.family, at))
    made.metrics += [
        metric("worst_ratio", "all", 6.0),
        metric("false_per_1000", "all", 3.0),
        metric("not_finite", "all", 0.0, low=None, high=None),
        metric("raised", "all", 2.0, low=None, high=None),
    ]
    made.data.failures = Failures(
        frames=2, causes=[Cause(cause="IndexError: [b]no", first="many:6", frames=2)]
    )
    return made


def test_a_page_has_a_row_a_model_and_a_table_a_family(fabricate: Any) -> None:
    page = board_page(PROTOCOL, [record(fabricate), record(fabricate, "mean", 10.0)], [])
    shown = {one.title: one for one in page.sections[0].tables}
    doubling = shown["Where the error doubles: value [95 % interval]"]
    # A model that is always wrong doubles nothing: no `mean`.
    assert [column.head for column in doubling.columns[2:]] == ["unet"]
    values = {row[0]: str(row[2]) for row in doubling.rows}
    assert values["deep, mm"] == "> 6.5"
    assert values["grazing, mm"].endswith("[0.45, 0.55]")
    assert "shift, px" in values
    assert "individual" not in values  # its values have no order
    assert "Speed and cost" not in shown


def test_six_models_have_a_legend_inside_the_figure_and_a_table_that_is_explained(
    fabricate: Any,
) -> None:
    names = ("unet", "superpose", "vgnn", "mixture", "cnn", "kernel")
    records = [record(fabricate, name, settings={"a_long_parameter": 12345}) for name in names]
    figure = stability_figure(rows_of(records), AXES)
    figure.draw_without_rendering()
    legend = figure.legends[0].get_window_extent()
    assert 0 <= legend.x0 < legend.x1 <= figure.bbox.x1
    (note,) = doubling_table(rows_of(records), AXES).notes
    assert "n/a: the easy case costs more than half the gate" in note


def printed(made: Record) -> str:
    console = Console(width=120, record=True, file=io.StringIO())
    print_run(console, made, Path("runs/x/record.json"), [], AXES)
    return console.export_text()


def test_a_terminal_shows_a_line_a_family_and_what_failed(fabricate: Any) -> None:
    text = printed(record(fabricate))
    lines = {line.split()[0].rstrip(","): line for line in text.split("\n") if line.strip()}
    for axis in AXES:
        assert axis.family in lines
    assert "> 6.5" in lines["deep"]
    assert "false contacts per 1,000 empty frames: 3.0 [2.7, 3.3]" in text
    assert "frames on which the model raised an exception: 2" in text
    assert "2 x IndexError: [b]no (first: many:6)" in text
    assert len(text.split("\n")) < 70  # the hundreds of cases are not listed one by one


def test_a_picture_leaves_out_what_is_not_known_or_zero(fabricate: Any) -> None:
    made = record(fabricate)
    for row in made.metrics:
        if row.group.startswith("blur"):
            row.value = row.low = row.high = None
        if row.metric == "ospa_mm" and row.group.startswith("deep"):
            row.value = row.low = row.high = 0.0
    some = [axis for axis in AXES if axis.family in {"blur", "deep"}]
    figure = stability_figure(rows_of([made]), some)
    points = [len(axes.containers[0][0].get_xdata()) for axes in figure.axes[:2]]  # type: ignore[index]
    assert max(points) <= 1  # the easy case alone, which belongs to another family
