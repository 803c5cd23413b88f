"""The page of real recordings: errors of every model on every recording, beside guessing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from tactibench.board import (
    GUESS,
    TRIVIAL,
    RealTest,
    agreement,
    real_tests,
    simulated_order,
)
from tactibench.protocols import board_spec, real_spec
from tactibench.records import Record
from tactibench.report.pages import render
from tactibench.report.tables import Cell, Column, Head, Number, Table, Text, fixed, table

UNSEEN = "unseen"
"""Group of the metrics on simulated sensors that no training saw."""


@dataclass(frozen=True)
class RealPage:
    """The page as data of a template.

    Attributes:
        tables: Tables of errors, and the agreement with simulated boards.
        records: Number of records whose values they show.
    """

    tables: tuple[Table, ...]
    records: int

    def markdown(self) -> str:
        """Return the page as it stands under ``leaderboards/``."""
        return render("real.md.j2", page=self)


def real_page(records: Mapping[str, Sequence[Record]]) -> RealPage:
    """Return the page of real recordings.

    Args:
        records: Records of the present version of each protocol, by its id.
    """
    tests = real_tests(records)
    own = [test for test in tests if not test.trained_on]
    others = [test for test in tests if test.trained_on]
    note = real_spec().note
    tables = [
        error_table(own, "Trained and tested on one recording", [note]),
        error_table(others, "Trained on one recording or sensor, tested on another", []),
        agreement_table(own, records.get(real_spec().simulated, ())),
    ]
    shown = {r.name for test in tests for row in test.rows.values() for r in row.records}
    return RealPage(tuple(one for one in tables if one.rows), len(shown))


def error_table(tests: Sequence[RealTest], title: str, notes: Iterable[str]) -> Table:
    """Return a table of errors: one line a test, one column a model, trivial ones last.

    Args:
        tests: Tests, in the order of the lines.
        title: Heading of the table.
        notes: Sentences below it.
    """
    counts = Counter(name for test in tests for name in test.rows if name != GUESS)
    models = sorted(counts, key=lambda name: (name in TRIVIAL, -counts[name], name))
    heads: list[Head] = ["recording", "error", Column("guessing"), *map(Column, models)]
    rows: list[list[Cell]] = []
    for test in tests:
        known = [f"trained on {test.trained_on}"] if test.trained_on else []
        known += [f"shown {test.shots} labelled presses of this one"] if test.shots else []
        line: list[Cell] = [
            Text(test.recording, below=", ".join(known)),
            Text(test.line.name, below=test.line.protocol),
            _guess(test),
        ]
        rows.append([*line, *(_cell(test, name) for name in models)])
    return table(heads, rows, title=title, notes=notes)


def _cell(test: RealTest, model: str) -> Cell:
    """Return the share of guessing, the error below it; the error alone where nothing guessed."""
    error, share = test.error(model), test.share(model)
    if error is None:
        return None
    text = _with_unit(test, error.value)
    return text if share is None else Number(share, fixed(3), below=text)


def _guess(test: RealTest) -> Cell:
    error = test.error(GUESS)
    return None if error is None else _with_unit(test, error.value)


def _with_unit(test: RealTest, value: float) -> str:
    return f"{value:.{test.line.decimals}f} {test.line.unit}".strip()


def agreement_table(tests: Iterable[RealTest], simulated: Sequence[Record]) -> Table:
    """Return Kendall's tau between the orders of models on recordings and on simulated boards.

    Args:
        tests: Tests on the recording of the training.
        simulated: Records of the protocol that is compared.
    """
    spec = real_spec()
    ranking = board_spec(spec.simulated).ranking
    nominal = "all" if ranking is None else ranking.group
    order = partial(simulated_order, simulated)
    boards = {"simulated sensor of the training": order(nominal), "unseen ones": order(UNSEEN)}
    rows: list[list[Cell]] = []
    for test in tests:
        found = [agreement(test.order, on_board) for on_board in boards.values()]
        if any(found):
            models = max(one.models for one in found if one is not None)
            taus = [None if one is None else Number(one.tau, fixed(2)) for one in found]
            rows.append([test.recording, test.line.protocol, Number(models, fixed(0)), *taus])
    heads: list[Head] = ["recording", "protocol", Column("models")]
    heads += [Column(f"tau: {name}") for name in boards]
    title = "Do simulated boards predict these orders?"
    return table(heads, rows, title=title, notes=[spec.tau_note])
