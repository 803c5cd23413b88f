#!/usr/bin/env python
"""Draw the README's picture and write its table, from the committed records.

python scripts/draw_readme.py            # docs/images/instances.png and the table of README.md
python scripts/draw_readme.py --check    # exit code 1 when the table is not what they give
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from tactibench.board import (
    OverviewLine,
    model_text,
    overview,
    read_submissions,
    shipped_models,
)
from tactibench.protocols import load_protocol, overview_spec, shipped_files
from tactibench.records import Record
from tactibench.report import overview_table, real_page, table_lines

ROOT = Path(__file__).resolve().parents[1]
PAGE, PICTURE = ROOT / "README.md", ROOT / "docs" / "images" / "instances.png"
BOARD = ROOT / "leaderboards"
BEGIN, END = "<!-- table: python scripts/draw_readme.py -->", "<!-- end of table -->"
SHOWN_SETTINGS = frozenset({"recipe", "faults"})
"""Settings of a model that the picture shows beside the defaults: the recipe of the paper, and the
training under faults, whose mean error on unseen sensors is smaller than that of the default."""


def read_records() -> dict[str, list[Record]]:
    """Return the committed records, by the protocol."""
    return {name: read_submissions(BOARD, name) for name in shipped_files()}


def shipped_lines(records: dict[str, list[Record]]) -> list[OverviewLine]:
    """Return the lines of the overview for the models that ship."""
    return [line for line in overview(records) if line.row.first.model.name in shipped_models()]


def _shown(line: OverviewLine) -> bool:
    record = line.row.first
    same = record.regime == "single" and record.sensor.name == "tactip-127"
    encoder = record.encoder.name if record.encoder else None
    return (
        same
        and set(record.model.changed) <= SHOWN_SETTINGS
        and encoder in {None, "hertz", record.model.name}
    )


def draw(lines: Sequence[OverviewLine], path: Path) -> None:
    """Draw the error of one contact of every model, on the nominal sensor and on unseen ones."""
    from matplotlib.figure import Figure

    from tactibench.report import model_look

    names = [column.name for column in overview_spec().columns]
    (unseen,) = (test for test in load_protocol("exp1").spec.test.apart if test.instances)
    groups = [f"{unseen.name}:instance-{number}" for number in unseen.instances]
    shown = [line for line in lines if line.values[names.index("unseen")] and _shown(line)]
    figure = Figure(figsize=(8.0, 0.38 * len(shown) + 1.3), layout="constrained")
    axes = figure.subplots()
    for place, line in enumerate(reversed(shown)):
        nominal = line.values[names.index("nominal")]
        metrics = [line.row.metric("gospa_depth_mm", group) for group in groups]
        others = [metric.value for metric in metrics if metric is not None]
        colour = model_look(line.row.first.model.name).color
        if nominal is not None:
            ends = [nominal.value, max(others)]
            axes.plot(ends, [place, place], color="#cccccc", linewidth=3, zorder=1)
            axes.plot([nominal.value], [place], "o", color=colour, markersize=10, zorder=3)
        hollow: dict[str, Any] = {
            "color": colour,
            "markerfacecolor": "white",
            "markeredgewidth": 1.6,
        }
        axes.plot(others, [place] * len(others), "D", markersize=6, zorder=2, **hollow)
    axes.set_yticks(range(len(shown)), [model_text(line.row.first) for line in reversed(shown)])
    axes.set_xscale("log")
    ticks = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5)
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.grid(axis="x", color="#eeeeee")
    axes.set_axisbelow(True)
    axes.set_xlabel("error of one contact, mm (GOSPA; a missed contact costs 1.5 mm)")
    axes.set_title(
        f"Dot: the sensor it was trained on.  Diamonds: {len(groups)} other sensors of the make.",
        fontsize=10,
        loc="left",
    )
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.tick_params(axis="y", length=0)
    figure.savefig(path, dpi=150, metadata={"Software": None})


def page_with(text: str, lines: Sequence[OverviewLine], validity: str) -> str:
    """Return the page with its table between the marks, and a sentence below it.

    Args:
        text: Text of the page.
        lines: Lines of the overview.
        validity: Whether simulated boards order the models as real recordings do.

    Raises:
        ValueError: The page lacks a mark.
    """
    begin = text.index(BEGIN) + len(BEGIN)
    shown = "\n".join(table_lines(overview_table(lines, brief=True)))
    below = f"{validity} [How it was measured](leaderboards/real.md)."
    return "\n\n".join([text[:begin], shown, below, text[text.index(END, begin) :]])


@click.command()
@click.option("--check", is_flag=True, help="Write nothing; exit 1 when the table is out of date.")
@click.pass_context
def main(ctx: click.Context, check: bool) -> None:
    """Draw the README's picture and write its table."""
    records = read_records()
    lines = shipped_lines(records)
    text = PAGE.read_text(encoding="utf-8")
    wanted = page_with(text, lines, real_page(records).validity)
    if check:
        same = wanted == text
        click.echo("the table is what the records give" if same else "the table is out of date")
        ctx.exit(not same)
    PAGE.write_text(wanted, encoding="utf-8")
    draw(lines, PICTURE)
    click.echo(f"wrote the table of {PAGE.name} and {PICTURE.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
