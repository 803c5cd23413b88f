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
from pathlib import Path

import click
import numpy as np
from matplotlib.axes import Axes

from tactibench.board import FamilyErrors, Row, family_errors, read_submissions
from tactibench.protocols import load_protocol
from tactibench.records import Record
from tactibench.report import (
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
BOARD = ROOT / "leaderboards"
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


def newest_rows(board: Path = BOARD) -> dict[str, Record]:
    """Return model -> its newest record of the newest version, trained on single presses.

    Only records of the protocol's own test are taken: the presses of others are not the same.
    """
    records = sorted(
        read_submissions(board, "stability"), key=lambda r: (r.protocol.version, str(r.created))
    )
    rows = {
        record.model.name: record
        for record in records
        if record.regime == "single" and not record.model.changed and record.test_sensor is None
    }
    return dict(sorted(rows.items()))


def draw_model(name: str, rows: dict[str, Record], path: Path) -> None:
    """Draw the errors of a model on the graded hard cases in front of those of all others.

    Args:
        name: Name of the model.
        rows: Model -> record, as ``newest_rows`` returns.
        path: File of the picture.
    """
    families = {axis.family: axis for axis in load_protocol("stability").spec.axes}
    axes = [families[family] for family in PANELS]
    figure = new_figure(8.0, 4.7)
    panels = figure.subplots(-(-len(PANELS) // COLUMNS), COLUMNS, sharey=True)
    curves = {model: family_errors(Row((record,)), axes) for model, record in rows.items()}
    for k, (panel, title) in enumerate(zip(panels.flat, PANELS.values(), strict=True)):
        for other in [model for model in curves if model not in (name, *TRIVIAL)]:
            _draw_curve(panel, curves[other][k], color="#CFCFCF", linewidth=1.0)
        _draw_own(panel, curves[name][k], name)
        _dress(panel, curves[name][k], title)
    for line in panels:
        line[0].set_ylabel("error, mm", fontsize=10)
    look = model_look(name).points
    figure.legend(
        handles=[
            legend_mark(name, markersize=7, **look),
            legend_mark("a tenth missed, or more", markersize=7, markerfacecolor="white", **look),
            *_draw_curve(panels[0, 0], None, color="#CFCFCF", label="the other models"),
            *_draw_curve(
                panels[0, 0], None, color=BLACK, linestyle=(0, (2, 2)), label="nothing found"
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


def _draw_curve(axes: Axes, curve: FamilyErrors | None, **look: object) -> Sequence[object]:
    """Draw a line, or marks where values have no order; None draws an empty line for a legend."""
    y = [] if curve is None else _errors(curve)
    if curve is not None and not curve.axis.ordered:
        look |= {"linestyle": "none", "marker": "_", "markersize": 9}
    return axes.plot(range(len(y)), y, zorder=1, **look)  # type: ignore[arg-type]


def _errors(curve: FamilyErrors) -> list[float]:
    return [np.nan if case.error is None else case.error.value for case in curve.cases]


def _draw_own(axes: Axes, curve: FamilyErrors, name: str) -> None:
    look, errors = model_look(name), _errors(curve)
    if curve.axis.ordered:
        axes.plot(range(len(errors)), errors, color=look.color, linewidth=2.2, zorder=3)
    for x, (error, case) in enumerate(zip(errors, curve.cases, strict=True)):
        many_missed = case.missed is not None and case.missed.value >= TENTH
        axes.plot(
            x,
            error,
            markersize=6.5,
            markerfacecolor="white" if many_missed else look.color,
            zorder=4,
            linestyle="none",
            **look.points,
        )


def _dress(axes: Axes, curve: FamilyErrors, title: str) -> None:
    values = [case.value for case in curve.cases]
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
