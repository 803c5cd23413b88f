"""Learning curves: the error of one configuration against the presses that it learned from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from tactibench.board.markdown import Head, plain, table
from tactibench.board.numbers import number
from tactibench.board.ranking import RankingError
from tactibench.board.rows import Pooled, Row
from tactibench.board.tables import MISSING, seeds


@dataclass(frozen=True)
class Step:
    """A point of a curve. presses: that the model learned from, without those that stop it."""

    presses: int
    error: Pooled | None
    seeds: int


@dataclass(frozen=True)
class Curve:
    """One configuration, the fewest presses first."""

    label: str
    steps: tuple[Step, ...]


def curves(rows: Iterable[Row], error: RankingError) -> list[Curve]:
    """Curves of at least two steps, by label. rows: of one sensor, with and without ``presses``."""
    found: dict[str, list[Step]] = {}
    for row in rows:
        count = row.first.data.train
        step = Step(count, row.metric(error.metric, error.group), len(row.records))
        found.setdefault(row.label, []).append(step)
    return [
        Curve(label, tuple(sorted(steps, key=lambda step: step.presses)))
        for label, steps in sorted(found.items())
        if len(steps) > 1
    ]


def counts(found: Sequence[Curve]) -> list[int]:
    """All numbers of presses, ascending."""
    return sorted({step.presses for curve in found for step in curve.steps})


def curve_lines(found: Sequence[Curve], error: RankingError) -> list[str]:
    """The curves as a Markdown table; nothing without any."""
    if not found:
        return []
    columns = counts(found)
    heads = [Head("model", right=False), *(Head(f"{count:,}") for count in columns)]
    body = []
    for curve in found:
        steps = {step.presses: step for step in curve.steps}
        body.append([plain(curve.label), *(_cell(steps.get(n), error.decimals) for n in columns)])
    note = (
        f"{error.name[0].upper()}{error.name[1:]}, {error.unit}, by the presses that a model "
        "learned from; the validation presses are the same in all. Below: the standard deviation "
        "over seeds, or how many there are."
    )
    return ["### Learning curve", "", *table(heads, body), "", note, ""]


def _cell(step: Step | None, decimals: int) -> str:
    if step is None or step.error is None:
        return MISSING
    sd = step.error.sd
    below = seeds(step.seeds) if sd is None else f"sd {number(sd, decimals)}"
    return f"{number(step.error.value, decimals)}<br><sub>{below}</sub>"
