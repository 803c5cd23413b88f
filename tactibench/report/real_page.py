"""The page of real recordings: errors of every model on every recording, beside guessing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

from tactibench.board import (
    GUESS,
    TRIVIAL,
    PooledMetric,
    RealTest,
    agreement,
    real_tests,
    simulated_orders,
)
from tactibench.protocols import real_spec
from tactibench.records import Record
from tactibench.report.pages import render
from tactibench.report.tables import (
    Cell,
    Column,
    Head,
    Number,
    Table,
    Text,
    fixed,
    metric_number,
    plural,
    significant,
    table,
)

KINDS = ("two real recordings", "a simulated board and a real recording", "two simulated boards")
"""Pairs of boards."""


@dataclass(frozen=True)
class RealPage:
    """The page as data of a template.

    Attributes:
        result: A sentence on the models with the smallest errors.
        validity: A sentence on whether simulated boards order the models as real recordings do; ""
            where too few models are on both.
        tables: Tables of errors, and the agreement with simulated boards.
        records: Number of records whose values they show.
    """

    result: str
    validity: str
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
    titles = dict.fromkeys(test.line.table for test in own)
    tables = [error_table([t for t in own if t.line.table == title], title) for title in titles]
    tables[:1] = [replace(one, notes=(real_spec().note,)) for one in tables[:1]]
    agreed = agreement_table(own, records.get(real_spec().simulated, ()))
    tables += [moved_table([test for test in tests if test.trained_on]), agreed]
    shown = {r.name for test in tests for row in test.rows.values() for r in row.records}
    return RealPage(
        _result(own), _validity(agreed), tuple(one for one in tables if one.rows), len(shown)
    )


def error_table(tests: Sequence[RealTest], title: str) -> Table:
    """Return a table of errors: a line a model, by its mean share, trivial ones last.

    Args:
        tests: Tests, one a column.
        title: Heading of the table.
    """

    def place(name: str) -> tuple[bool, float]:
        shares = [share for test in tests if (share := test.share(name)) is not None]
        return name in TRIVIAL, sum(shares) / len(shares) if shares else 1.0

    models = sorted({name for test in tests for name in test.rows}, key=lambda n: (place(n), n))
    heads = [f"{test.recording}: {test.line.name}" for test in tests]
    rows = [[_name(model), *(_cell(test, model) for test in tests)] for model in models]
    return table(["model", *map(Column, heads)], rows, title=title)


def moved_table(tests: Iterable[RealTest]) -> Table:
    """Return the errors of models on another recording than that of their training.

    There is one line a pair of recordings and model, and one column for each number of labelled
    presses of the tested recording that a model was shown.
    """
    lines: dict[tuple[str, str, str], dict[int, RealTest]] = {}
    for test in tests:
        group = test.line.group
        shots = int(group) if group.isdigit() else test.shots
        for model in sorted(test.rows, key=lambda name: (name in TRIVIAL, name)):
            if model != GUESS:
                pair = (test.recording, test.trained_on, model)
                lines.setdefault(pair, {})[shots] = test
    shown = sorted({shots for found in lines.values() for shots in found})
    rows: list[list[Cell]] = []
    for (recording, trained_on, model), found in lines.items():
        guess = next(iter(found.values())).error(GUESS)
        where = Text(recording, below=f"trained on {trained_on}")
        cells = (_cell(found[shots], model) if shots in found else None for shots in shown)
        guessed = None if guess is None else Number(guess.value, significant)
        rows.append([where, _name(model), guessed, *cells])
    heads: list[Head] = ["tested on", "model", Column("error of the model mean, mm")]
    heads += [Column(f"{'' if k else 'labelled presses shown: '}{n}") for k, n in enumerate(shown)]
    title = "Trained on one recording or sensor, tested on another"
    note = "Values as above; the error alone where `mean` was not tested."
    return table(heads, rows, title=title, notes=[note])


def _name(model: str) -> Text:
    return Text(model, "italic" if model in TRIVIAL else "")


def _cell(test: RealTest, model: str) -> Cell:
    """Return the share of guessing, the error below it; the error alone where nothing guessed."""
    number, share = metric_number(test.error(model), test.line.decimals), test.share(model)
    if number is None or not test.line.unit:  # a share of wrong sets is that of guessing already
        return number
    text = ", ".join([f"{number.text} {test.line.unit}", *number.small])
    return text if share is None else Number(share, fixed(3), below=text)


def _result(tests: Iterable[RealTest]) -> str:
    """Return which models have the smallest errors, and on how many tests that may be chance."""
    orders = [test.order for test in tests if len(test.order) > 1]  # one model is no comparison
    if not orders:
        return ""
    ordered = [sorted(order, key=lambda model: order[model].value) for order in orders]
    leads = Counter(best for best, *_ in ordered).most_common()
    close = sum(
        _overlap(order[first], order[second])
        for order, (first, second, *_) in zip(orders, ordered, strict=True)
    )
    result = (
        f"The smallest error of {plural(len(orders), 'test')}: "
        f"{', '.join(f'{model} on {count}' for model, count in leads)}."
    )
    if not close:
        return result
    return (
        f"{result} On {close} of them the 95 % intervals of the first two models overlap, so that "
        "chance may decide."
    )


def _overlap(smaller: PooledMetric, larger: PooledMetric) -> bool:
    """Return whether the intervals of two errors overlap; True where an end is not known."""
    return smaller.high is None or larger.low is None or smaller.high >= larger.low


def agreement_table(tests: Iterable[RealTest], simulated: Sequence[Record]) -> Table:
    """Return Kendall's tau between the orders of models on recordings and on simulated boards.

    Args:
        tests: Tests on the recording of the training.
        simulated: Records of the protocol that is compared.
    """
    orders = simulated_orders(simulated)
    boards = list(orders)
    for test in tests:
        orders.setdefault(f"{test.recording} ({test.line.protocol})", test.order)
    rows: list[list[Cell]] = []
    for one, other in combinations(orders, 2):
        found = agreement(orders[one], orders[other])
        if found is not None:
            tau = Number(found.tau, fixed(2), (found.low, found.high))
            kind = KINDS[(one in boards) + (other in boards)]
            rows.append([kind, one, other, Number(found.models, fixed(0)), tau])
    rows.sort(key=lambda row: KINDS.index(str(row[0])))
    heads: list[Head] = ["pair of", "order on", "and on", Column("models"), Column("tau")]
    title = "Do simulated boards predict the order of models on real sensors?"
    return table(heads, rows, title=title, notes=[real_spec().tau_note])


def _validity(agreed: Table) -> str:
    """Return the taus of the pairs of boards that hold a real recording, in a sentence."""
    parts = []
    for kind in KINDS[:2]:
        taus = [row[-1] for row in agreed.rows if row[0] == kind]
        ends = sorted((tau for tau in taus if isinstance(tau, Number)), key=lambda tau: tau.value)
        if ends:
            span = " to ".join(dict.fromkeys((ends[0].text, ends[-1].text)))
            parts.append(f"{span} for {kind}")
    return f"Kendall's tau between the orders of models: {'; '.join(parts)}." if parts else ""
