#!/usr/bin/env python
"""Draw where each model fails, the pictures of docs/models.md, from the committed records.

python scripts/draw_models.py            # docs/images/fails-MODEL.png, one for each model
python scripts/draw_models.py vgnn       # of one model alone

A picture shows the newest row of protocol ``stability`` that a model has, trained on single presses
with its default parameters. After a new row was added (``tactibench run stability --model vgnn``,
``tactibench board add``), draw all pictures again: each has the other models behind its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from matplotlib.axes import Axes

from tactibench.protocols.families import Axis
from tactibench.protocols.loader import load_protocol
from tactibench.records.record import Record
from tactibench.report.plots.style import (
    BLACK,
    GREY,
    TRIVIAL,
    headline,
    legend_mark,
    log_ticks,
    model_look,
    new_figure,
    plain,
    save_png,
)

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs" / "images"
SUBMISSIONS = ROOT / "leaderboards" / "submissions" / "stability"
GATE_MM = 3.0
"""Error of a contact that was missed or invented."""
LOWEST_MM = 0.003
"""Lower end of the axis: no model errs less on its easiest case."""
TENTH = 0.1
"""Marks are hollow where at least this share of the contacts was missed."""
PANELS = {
    "near": "two tips, so many mm apart",
    "individual": "other sensors, by number",
    "shift": "camera shifted, px",
    "rotation": "camera turned, degrees",
    "blur": "blur, px",
    "dim": "less light, share",
}
"""Family of hard cases -> title of its panel."""
COLUMNS = 3


@dataclass(frozen=True)
class Curve:
    """Error of one model along a family, the easy case first.

    Attributes:
        values: Value of each case, such as a distance.
        errors_mm: OSPA of each case, mm; NaN where there is none.
        missed: Share of the contacts missed in each case.
    """

    values: tuple[float, ...]
    errors_mm: tuple[float, ...]
    missed: tuple[float, ...]


def newest_rows(folder: Path = SUBMISSIONS) -> dict[str, Record]:
    """Return model -> its newest record of the newest version, trained on single presses.

    Only records of the protocol's own test are taken: the presses of others are not the same.
    """
    rows: dict[str, Record] = {}
    for path in sorted(folder.glob("*.json")):
        record = Record.model_validate_json(path.read_text(encoding="utf-8"))
        if record.regime != "single" or record.model.changed or record.test_sensor is not None:
            continue
        newest = rows.get(record.model.name)
        if newest is None or _age(newest) < _age(record):
            rows[record.model.name] = record
    return rows


def _age(record: Record) -> tuple[int, str]:
    return record.protocol.version, str(record.created)


def curve_of(record: Record, axis: Axis) -> Curve:
    """Return the errors of a record along a family."""
    cases = list(zip(axis.values, axis.groups, strict=True))
    if axis.easy is not None:
        cases.insert(0, (axis.easy, axis.reference))
    errors = [record.value("ospa_mm", group) for _, group in cases]
    missed = [record.value("missed", group) for _, group in cases]
    return Curve(
        tuple(value for value, _ in cases),
        tuple(np.nan if error is None else error for error in errors),
        tuple(0.0 if share is None else share for share in missed),
    )


def draw_model(name: str, rows: dict[str, Record], path: Path) -> None:
    """Draw the errors of a model on the graded hard cases in front of those of all others.

    Args:
        name: Name of the model.
        rows: Model -> record, as ``newest_rows`` returns.
        path: File of the picture.
    """
    axes = {axis.family: axis for axis in load_protocol("stability").spec.axes}
    figure = new_figure(8.0, 4.7)
    panels = figure.subplots(-(-len(PANELS) // COLUMNS), COLUMNS, sharey=True)
    others = [row for other, row in rows.items() if other not in (name, *TRIVIAL)]
    for panel, (family, title) in zip(panels.flat, PANELS.items(), strict=True):
        axis = axes[family]
        for row in others:
            _draw_curve(panel, curve_of(row, axis), axis.ordered, color="#CFCFCF", linewidth=1.0)
        _draw_own(panel, curve_of(rows[name], axis), axis.ordered, name)
        _dress(panel, axis, title)
    for line in panels:
        line[0].set_ylabel("error, mm", fontsize=10)
    look = model_look(name).points
    figure.legend(
        handles=[
            legend_mark(name, markersize=7, **look),
            legend_mark("a tenth missed, or more", markersize=7, markerfacecolor="white", **look),
            *_draw_curve(panels[0, 0], None, True, color="#CFCFCF", label="the other models"),
            *_draw_curve(
                panels[0, 0], None, True, color=BLACK, linestyle=(0, (2, 2)), label="nothing found"
            ),
        ],
        loc="outside lower center",
        ncols=4,
        frameon=False,
        fontsize=10,
    )
    record = rows[name]
    headline(
        figure,
        f"Where {name} fails: left the easy case of each family, right the hardest",
        f"stability@{record.protocol.version}, {record.sensor.name}, trained on single presses",
        f"row of {str(record.created)[:10]}",
    )
    save_png(figure, path)


def _draw_curve(axes: Axes, curve: Curve | None, ordered: bool, **look: object) -> Sequence[object]:
    """Draw a line, or marks where values have no order; None draws an empty line for a legend."""
    x, y = ([], []) if curve is None else (range(len(curve.values)), curve.errors_mm)
    if not ordered:
        look |= {"linestyle": "none", "marker": "_", "markersize": 9}
    return axes.plot(x, y, zorder=1, **look)  # type: ignore[arg-type]


def _draw_own(axes: Axes, curve: Curve, ordered: bool, name: str) -> None:
    look = model_look(name)
    x = np.arange(len(curve.values))
    if ordered:
        axes.plot(x, curve.errors_mm, color=look.color, linewidth=2.2, zorder=3)
    for place, error, missed in zip(x, curve.errors_mm, curve.missed, strict=True):
        face = "white" if missed >= TENTH else look.color
        axes.plot(
            place,
            error,
            markersize=6.5,
            markerfacecolor=face,
            zorder=4,
            linestyle="none",
            **look.points,
        )


def _dress(axes: Axes, axis: Axis, title: str) -> None:
    values = [*([] if axis.easy is None else [axis.easy]), *axis.values]
    axes.set_xticks(range(len(values)), [f"{value:g}" for value in values], fontsize=9)
    axes.set(yscale="log", ylim=(LOWEST_MM, 1.6 * GATE_MM), xlim=(-0.4, len(values) - 0.6))
    log_ticks(axes.yaxis, (1,))
    axes.tick_params(axis="y", labelsize=9)
    axes.set_title(title, fontsize=10, loc="left")
    plain(axes)
    axes.axhline(GATE_MM, color=BLACK, linewidth=1.0, linestyle=(0, (2, 2)), zorder=0)
    axes.axvline(0.5, color=GREY, linewidth=0.6, linestyle=(0, (1, 2)), zorder=0)


@click.command()
@click.argument("models", nargs=-1)
def main(models: tuple[str, ...]) -> None:
    """Draw docs/images/fails-MODEL.png of MODELS, or of all that have a row."""
    rows = newest_rows()
    for name in models or sorted(rows):
        if name not in rows:
            raise click.BadParameter(f"{name} has no row; there are: {', '.join(sorted(rows))}.")
        draw_model(name, rows, IMAGES / f"fails-{name}.png")


if __name__ == "__main__":
    main()
