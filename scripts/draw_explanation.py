#!/usr/bin/env python
"""Draw the pictures of docs/explanation.md and write its table, from the committed records.

python scripts/draw_explanation.py            # docs/images/misses.png, same_machine.png, table
python scripts/draw_explanation.py --check    # exit code 1 when the table is not what they give
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import click
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from tactibench.board import TRIVIAL, Row, gather_records, latency, machine, select_section
from tactibench.records import atomic
from tactibench.report import (
    GREY,
    Column,
    Text,
    headline,
    log_ticks,
    metric_number,
    model_look,
    new_figure,
    plain,
    save_png,
    table,
    table_lines,
)

ROOT = Path(__file__).resolve().parents[1]
PAGE, IMAGES = ROOT / "docs" / "explanation.md", ROOT / "docs" / "images"
BEGIN, END = "<!-- table: python scripts/draw_explanation.py -->", "<!-- end of table -->"
MOST = "multiple"
"""The regime whose marks are filled."""
DECIMALS = {"missed": 1}
TABLE = ("position_mean_mm", "missed", "spurious", "gospa_depth_mm")
HEADS = (
    "model",
    "regime",
    "seeds",
    "position error of found contacts, mm",
    "missed, %",
    "spurious / frame",
    "GOSPA, mm",
)


def board_rows(protocol: str, board: Path = ROOT / "leaderboards") -> list[Row]:
    """Return the rows of a board: the sensor with most runs, default parameters, no trivial models.

    Models are trained and tested on that sensor. Rows with another encoder, with mixing or with
    other changes are left out.

    Args:
        protocol: Name of the protocol.
        board: Folder of the boards.
    """
    section = select_section(gather_records(protocol, board, None), None, protocol)
    return [row for row in section.rows if _model(row) not in TRIVIAL and _plain(row)]


def _plain(row: Row) -> bool:
    return (
        row.model == _model(row)
        and "mixing" not in row.first.model.changed
        and not ({"depth", "offset", "axes"} & {row.encoder.partition(",")[0]})
    )


def looks(rows: Iterable[Row]) -> dict[str, dict[str, Any]]:
    """Return model -> colour and marker."""
    return {model: model_look(model).points for model in sorted({_model(row) for row in rows})}


def _model(row: Row) -> str:
    return row.first.model.name


def misses_picture(path: Path, rows: Sequence[Row]) -> None:
    """Draw the position error of matched pairs against the share missed, a mark a training seed."""
    figure = new_figure(8.0, 4.8)
    axes = figure.subplots()
    look = looks(rows)
    for row in rows:
        style = look[_model(row)]
        x = [100 * _value(record, "missed") for record in row.records]
        y = [_value(record, "position_mean_mm") for record in row.records]
        face = style["color"] if row.regime == MOST else "white"
        axes.plot(
            x, y, linestyle="none", markersize=8, markeredgewidth=1.5, markerfacecolor=face, **style
        )
    axes.set(
        xlabel="contacts missed, %",
        ylabel="position error of the contacts that were found, mm",
        yscale="log",
        xlim=(-2, 100),
    )
    log_ticks(axes.yaxis)
    plain(axes)
    axes.legend(handles=_legend(look), frameon=False, fontsize=9, loc="lower right")
    headline(
        figure,
        "Experiment 3: an error is one of the contacts that were found",
        "simulated sensor tactip-127, 1,000 pairs and 1,000 triples; a mark a training seed",
    )
    save_png(figure, path)


def same_machine_picture(path: Path, rows: Sequence[Row]) -> None:
    """Draw the p90 of every seed of the configurations that ``timed_alike`` returns."""
    drawn = timed_alike(rows)
    figure = new_figure(8.0, 0.42 * len(drawn) + 1.6)
    axes = figure.subplots()
    look = looks(rows)
    for k, row in enumerate(drawn):
        times = row.over(_p90)
        style = look[_model(row)]
        axes.plot([min(times), max(times)], [k, k], color=GREY, linewidth=1.2, zorder=1)
        axes.plot(times, [k] * len(times), linestyle="none", markersize=8, **style)
        axes.text(
            max(times) * 1.06,
            k,
            f"x {max(times) / min(times):.1f}",
            va="center",
            fontsize=9,
            color=GREY,
        )
    axes.set_yticks(range(len(drawn)), [row.label for row in drawn], fontsize=9)
    axes.set(xscale="log", xlabel="one frame to contacts, p90 on one thread, ms")
    _plain_log(axes, drawn)
    plain(axes)
    headline(
        figure,
        "Experiment 2: trainings of one network, timed one after the other on a quiet machine",
        "the same arithmetic every time; x: slowest over fastest",
    )
    save_png(figure, path)


def timed_alike(rows: Iterable[Row]) -> list[Row]:
    """Return the rows whose several seeds were all timed in one arithmetic on one machine."""
    return [row for row in rows if len(row.over(_p90)) > 1 and len(_timed_as(row)) == 1]


def _timed_as(row: Row) -> set[tuple[str, str]]:
    """Return the arithmetic and the machine of the times of each seed."""
    return {(str(record.timed.get("configuration")), machine(record)) for record in row.records}


def _plain_log(axes: Axes, rows: Sequence[Row]) -> None:
    ends = [time for row in rows for time in row.over(_p90)]
    axes.set_xlim(min(ends) / 1.15, max(ends) * 1.35)
    axes.set_xticks(
        [t for t in (2, 3, 4, 5, 6, 8, 10, 15, 20, 30) if min(ends) / 1.15 < t < max(ends) * 1.35]
    )
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_minor_formatter(lambda *_: "")


def _legend(look: dict[str, dict[str, Any]]) -> list[Line2D]:
    named = [
        Line2D([], [], linestyle="none", markersize=8, label=model, **style)
        for model, style in look.items()
    ]
    hollow = Line2D(
        [],
        [],
        linestyle="none",
        marker="o",
        markersize=8,
        markerfacecolor="white",
        color=GREY,
        label="hollow: trained on single presses only",
    )
    return [*named, hollow]


def error_table(rows: Iterable[Row]) -> list[str]:
    """Return the lines of the table: means over seeds, without a mark for the best of a column."""
    body = [
        [
            Text(_model(row), "code"),
            row.regime,
            str(len(row.records)),
            *(
                metric_number(row.metric(name, "all"), DECIMALS.get(name, 3), interval=False)
                for name in TABLE
            ),
        ]
        for row in rows
    ]
    columns = [Column(head, right=k > 1) for k, head in enumerate(HEADS)]
    return table_lines(table(columns, body))


def _value(record: Any, metric: str) -> float:
    return float(record.value(metric, "all"))


def _p90(record: Any) -> float | None:
    return latency(record, threads=1)


def with_table(page: str, lines: Sequence[str]) -> str:
    """Return the page with the given table between its two marks."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    return "\n".join([f"{before}{BEGIN}", "", *lines, "", f"{END}{after}"])


@click.command()
@click.option("--check", is_flag=True, help="Write nothing; exit 1 when the table is out of date.")
@click.pass_context
def main(ctx: click.Context, check: bool) -> None:
    """Draw the pictures of docs/explanation.md and write its table."""
    exp3 = board_rows("exp3")
    page = PAGE.read_text(encoding="utf-8")
    wanted = with_table(page, error_table(exp3))
    if check:
        if wanted != page:
            click.echo(
                f"{PAGE.name} is not what the records give; run "
                "`python scripts/draw_explanation.py`.",
                err=True,
            )
        ctx.exit(int(wanted != page))
    misses_picture(IMAGES / "misses.png", exp3)
    same_machine_picture(IMAGES / "same_machine.png", board_rows("exp2"))
    with atomic(PAGE) as stream:
        stream.write(wanted.encode())


if __name__ == "__main__":
    main()
