#!/usr/bin/env python
"""Write the tables of docs/replication.md: the paper's numbers beside those of the boards.

python scripts/make_replication.py            # the tables of docs/replication.md
python scripts/make_replication.py --check    # exit code 1 when they are not what the records give
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import click
import numpy as np
from scipy.special import stdtrit

from tactibench.board import (
    FEWEST_SEEDS,
    Errors,
    Row,
    all_press_errors,
    ranking_error,
    read_submissions,
    sections_of,
)
from tactibench.protocols import PublishedRow, load_protocol, load_published, rows_for
from tactibench.report import (
    Cell,
    Column,
    Head,
    Number,
    Table,
    fixed,
    metric_number,
    number,
    table,
    table_lines,
)

ROOT = Path(__file__).resolve().parents[1]
PAGE, BOARD = ROOT / "docs" / "replication.md", ROOT / "leaderboards"
MARKS = "<!-- {}: python scripts/make_replication.py -->", "<!-- end of {} -->"
ENCODER = "hertz"
"""The heatmap of the paper, which is the default of all three protocols, too."""
NOT_RUN = "not run"
TOO_FEW = "fewer than three seeds"
OTHER_PRESSES = "not the same presses"


@dataclass(frozen=True)
class System:
    """One system of the comparison: a model, its regime, and what differs from the default.

    Attributes:
        model: Name of the model in this project.
        regime: Regime of the training.
        settings: Parameters of the model that are not the default.
        decoder: Parameters of the encoder that are not the default.
    """

    model: str
    regime: str = "single"
    settings: Mapping[str, Any] = field(default_factory=dict)
    decoder: Mapping[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name in a table, such as "U-Net, multiple"."""
        shown = {"unet": "U-Net", "cnn": "CNN", "vgnn": "vgnn"}[self.model]
        return shown if self.regime == "single" else f"{shown}, {self.regime}"

    def is_of(self, row: Row) -> bool:
        """Return whether a row of a board is this system."""
        record = row.first
        if record.model.name != self.model or record.regime != self.regime:
            return False
        encoder = record.encoder
        if encoder is not None and (encoder.name, encoder.changed) != (ENCODER, self.decoder):
            return False
        return record.model.changed == self.settings


def default(model: str, regime: str = "single") -> System:
    """Return a model of this project as it is."""
    return System(model, regime)


def paper(model: str, regime: str = "single", *, threshold: float | None = None) -> System:
    """Return a model with the recipe of the paper; the U-Net with its decoder.

    Args:
        model: Name of the model.
        regime: Regime of the training.
        threshold: Height from which a peak of the heatmap is a contact; None: the default.
    """
    decoder = {} if model == "cnn" else {"decoder": "maximum"}
    chosen = {} if threshold is None else {"threshold": threshold}
    return System(model, regime, {"recipe": "paper"}, {**decoder, **chosen})


class Board:
    """The rows of one protocol on the simulated sensor, and their errors press by press."""

    def __init__(self, protocol: str) -> None:
        self.protocol = protocol
        version = load_protocol(protocol)
        records = read_submissions(BOARD, protocol)
        nominal = [section for section in sections_of(records) if section.nominal]
        self.rows = next((section.rows for section in nominal if section.origin == "simulated"), ())
        self.published = [
            row
            for paper in load_published(version.spec.published.tables, BOARD / "published")
            for row in rows_for(protocol, paper)
        ]

    @cached_property
    def errors(self) -> Errors:
        """Errors press by press, by the name of the record."""
        records = [record for row in self.rows for record in row.records]
        return all_press_errors(BOARD, records)

    def row(self, system: System) -> Row | None:
        """Return the row of a system, None where it was not run."""
        return next((row for row in self.rows if system.is_of(row)), None)


Metrics = tuple[tuple[str, str, str, int], ...]
"""Metric, group, head and decimals of the columns of a table."""
METRICS: dict[str, Metrics] = {
    "exp1": (
        *(("mae_mm", axis, f"MAE {axis}, mm", 4) for axis in ("x", "y", "z", "mean")),
        ("rmse_mm", "mean", "RMSE, mm", 4),
        ("missed", "all", "missed, %", 2),
    ),
    "exp2": (
        ("distance_mae_mm", "all", "distance of pairs seen as two, mm", 3),
        ("resolved", "all", "seen as two, %", 1),
        ("distance_penalised_mm", "all", "penalised distance, mm", 3),
        ("threshold_mm", "all", "threshold, mm", 2),
    ),
    "exp3": (
        *(("position_mean_mm", group, f"position {group}, mm", 3) for group in ("dual", "triple")),
        *(("depth_mae_mm", group, f"depth {group}, mm", 3) for group in ("dual", "triple")),
        *(("missed", group, f"missed {group}, %", 2) for group in ("dual", "triple")),
    ),
}
RECIPE, DEFAULT = "here, the paper's recipe", "here, default"
WIDE = replace(paper("unet"), settings={"recipe": "paper", "width": 16})
UNMIXED = System("unet", settings={"mixing": 0.0})
SYSTEMS: dict[str, tuple[tuple[str, System], ...]] = {
    "exp1": (
        (RECIPE, paper("cnn")),
        (RECIPE, paper("unet")),
        (DEFAULT, default("cnn")),
        (DEFAULT, default("unet")),
    ),
    "exp2": (
        (RECIPE, paper("unet")),
        (f"{RECIPE}, peaks from 0.05", paper("unet", threshold=0.05)),
        (f"{RECIPE}, peaks from 0.2", paper("unet", threshold=0.2)),
        (f"{RECIPE}, width 16", WIDE),
        (RECIPE, paper("unet", "multiple")),
        (f"{DEFAULT}, without mixing", UNMIXED),
        (DEFAULT, default("vgnn")),
        (DEFAULT, default("unet")),
        (DEFAULT, default("unet", "multiple")),
    ),
    "exp3": (
        (RECIPE, paper("unet")),
        (RECIPE, paper("unet", "multiple")),
        (f"{DEFAULT}, without mixing", UNMIXED),
        (DEFAULT, default("vgnn")),
        (DEFAULT, default("unet")),
        (DEFAULT, default("unet", "multiple")),
    ),
}
"""Lines of the tables: where a system was measured, and the system."""


def results(board: Board) -> Table:
    """Return the table of printed and measured results, a line for each system and recipe."""
    columns = METRICS[board.protocol]
    heads: list[Head] = [
        "system",
        "where",
        Column("n"),
        *(Column(head) for *_, head, _ in columns),
    ]
    lines: list[list[Cell]] = []
    for published in board.published:
        values = (_printed(published, *column) for column in columns)
        regime = "" if published.regime == "single" else f", {published.regime}"
        count = Number(published.n, "{:,.0f}".format) if published.n else None
        lines.append([f"{published.model}{regime}", "printed, real sensor", count, *values])
    for where, system in SYSTEMS[board.protocol]:
        if row := board.row(system):
            lines.append([system.name, where, *_found(row, columns)])
    return table(heads, lines)


def _printed(row: PublishedRow, metric: str, group: str, _: str, digits: int) -> Cell:
    value = row.metrics.get(metric, {}).get(group)
    return None if value is None else Number(value, fixed(digits))


def _found(row: Row, columns: Metrics) -> Iterator[Cell]:
    yield f"{len(row.seeds)} seeds" if len(row.seeds) > 1 else "1 seed"
    for metric, group, _, digits in columns:
        pooled = row.metric(metric, group)
        yield metric_number(pooled, digits, below="" if pooled is None else pooled.limits)


Pair = tuple[System, System]
CLAIMS: tuple[tuple[str, str, Pair, Pair], ...] = (
    (
        "exp1: U-Net minus CNN",
        "exp1",
        (paper("unet"), paper("cnn")),
        (default("unet"), default("cnn")),
    ),
    *(
        (
            f"{protocol}: multiple minus single",
            protocol,
            (paper("unet", "multiple"), paper("unet")),
            (default("unet", "multiple"), default("unet")),
        )
        for protocol in ("exp2", "exp3")
    ),
)
"""Claims of the paper: title, protocol, and two systems, of which the first beats or equals the
second: by the paper's recipe, and by the default."""


def differences(boards: Mapping[str, Board]) -> Table:
    """Return the table of the claimed differences, press by press, with their intervals."""
    heads: list[Head] = [
        "difference",
        "error",
        Column("the paper's recipe"),
        Column("default"),
    ]
    lines = []
    for name, protocol, *pairs in CLAIMS:
        cells = (_difference(boards[protocol], *pair) for pair in pairs)
        error = ranking_error(protocol)
        lines.append([name, f"{error.name}, {error.unit}", *cells])
    return table(heads, lines)


def _difference(board: Board, first: System, second: System) -> Cell:
    first_row, second_row = board.row(first), board.row(second)
    if first_row is None or second_row is None:
        return NOT_RUN
    found = [
        [board.errors[record.name] for record in row.records] for row in (first_row, second_row)
    ]
    if min(map(len, found)) < FEWEST_SEEDS:
        return TOO_FEW
    if len({tuple(errors.press) for row in found for errors in row}) > 1:
        return OTHER_PRESSES
    systems = [np.array([errors.error for errors in row]) for row in found]
    first_errors, second_errors = (table.mean(axis=0) for table in systems)
    apart = first_errors - second_errors
    of_presses = apart.var(ddof=1) / len(apart), len(apart) - 1.0
    of_seeds = [(t.mean(axis=1).var(ddof=1) / len(t), len(t) - 1.0) for t in systems]
    # The ranks of a board take the wider of seeds alone and of both, too (tactibench.stats.paired).
    half = max(half_width(of_seeds), half_width([*of_seeds, of_presses]))
    mean = float(apart.mean())
    return Number(mean, signed, (mean - half, mean + half))


def half_width(terms: Sequence[tuple[float, float]]) -> float:
    """Return half of a 95 % interval, of variances with their degrees of freedom (Welch 1947).

    It is 0 without any variance.
    """
    variance = sum(variance for variance, _ in terms)
    if variance == 0:
        return 0.0
    freedom = variance**2 / sum(variance**2 / freedom for variance, freedom in terms)
    return float(stdtrit(freedom, 0.975) * np.sqrt(variance))


def signed(value: float) -> str:
    """Return a number with its sign."""
    text = number(value, 3)
    return text if value < 0 else f"+{text}"


def page_with(text: str, tables: Mapping[str, Table]) -> str:
    """Return the page with every table between its marks.

    Args:
        text: Text of the page.
        tables: Name in the marks -> table.

    Raises:
        ValueError: The page lacks a mark of a table.
    """
    for name, shown in tables.items():
        begin, end = (mark.format(name) for mark in MARKS)
        before, _, rest = text.partition(begin)
        after = rest[rest.index(end) :]
        lines = "\n".join(table_lines(shown))
        text = f"{before}{begin}\n\n{lines}\n\n{after}"
    return text


def all_tables() -> dict[str, Table]:
    """Return the tables of the page by their names."""
    boards = {name: Board(name) for name in METRICS}
    return {
        **{name: results(board) for name, board in boards.items()},
        "differences": differences(boards),
    }


@click.command()
@click.option("--check", is_flag=True, help="Write nothing; exit 1 when a table is out of date.")
@click.pass_context
def main(ctx: click.Context, check: bool) -> None:
    """Write the tables of docs/replication.md."""
    text = PAGE.read_text(encoding="utf-8")
    wanted = page_with(text, all_tables())
    if check:
        same = wanted == text
        click.echo("the tables are what the records give" if same else "a table is out of date")
        ctx.exit(not same)
    PAGE.write_text(wanted, encoding="utf-8")
    click.echo(f"wrote the tables of {PAGE.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
