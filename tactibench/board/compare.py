"""Stored runs compared with each other, press by press.

For every metric that is a mean over presses a comparison holds its mean over the presses for which
both runs have a value, the paired difference with its t interval, and the p value of a two-sided
sign-flip permutation test, adjusted by Holm's method over all that are shown together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from tactibench.board.model_overview import ERROR
from tactibench.board.rows import label_of, section_key
from tactibench.contacts import FloatArray
from tactibench.errors import UserError
from tactibench.metrics import (
    FIELDS,
    AnyTrials,
    PlateTrials,
    Trials,
    by_kind,
    compared_metrics,
    find_metric,
    press_means,
)
from tactibench.records import StoredRun, canonical, measured_on
from tactibench.run import protocol_of, trials_of
from tactibench.stats import Estimate, holm, mean_interval, sign_flip_ps

COMPARISON_STREAM = 1_000_001
"""Spawn key of the data seed behind the permutations."""
MISSES = ("missed", "coverage")
"""Shares that stand beside every error: of contacts missed, or of plate frames answered."""

Cell = tuple[str, str]
"""(metric, group)"""


@dataclass(frozen=True)
class MetricComparison:
    """One metric of one group in two runs.

    Attributes:
        metric: Name of the metric.
        group: Name of the group.
        first: Mean of the first run over the presses that both have; None: they share none.
        second: The same of the second run.
        difference: First minus second; its n and clusters are the number of shared presses.
        alone: Number of presses for which only the first, and only the second run has a value.
        misses: ``missed`` of both runs as recorded (``coverage`` for plates); None where the metric
            itself is one of these, or a record lacks it.
        p: p value; None for fewer than two presses.
        p_holm: p value adjusted by Holm's method; None as ``p``.
    """

    metric: str
    group: str
    first: float | None
    second: float | None
    difference: Estimate
    alone: tuple[int, int]
    misses: tuple[float, float] | None
    p: float | None
    p_holm: float | None = None


@dataclass(frozen=True)
class Comparison:
    """The comparison of two runs.

    Attributes:
        first: Place of the first run in the list of runs.
        second: Place of the second run.
        rows: One row a metric and group.
    """

    first: int
    second: int
    rows: tuple[MetricComparison, ...]


@dataclass(frozen=True, eq=False)
class _PressMeans:
    """The metrics of one run, press by press.

    Attributes:
        means: Mean of every press, (P,), by metric and group; nan where a press has no value.
        misses: The metric of MISSES that the record holds, by group.
        level: Level of the intervals.
    """

    means: Mapping[Cell, FloatArray]
    misses: Mapping[str, float | None]
    level: float


def compare_runs(
    runs: Sequence[StoredRun], advance: Callable[[int], None] = lambda _: None
) -> list[Comparison]:
    """Compare every run with every later one.

    Args:
        runs: Runs of the same protocol on the same test frames.
        advance: Called with 1 for every run that is read and every pair that is compared.

    Raises:
        UserError: The runs did not answer the same frames of the same protocol, or a run is named
            twice.
    """
    refuse_unlike(runs)
    protocol = protocol_of(runs[0])
    measured, comparisons = [], []
    for run in runs:
        measured.append(_measure(run))
        advance(1)
    seed = np.random.SeedSequence(protocol.spec.data_seed, spawn_key=(COMPARISON_STREAM,))
    pairs = list(combinations(range(len(runs)), 2))
    streams = map(np.random.default_rng, seed.spawn(len(pairs)))
    for (i, j), rng in zip(pairs, streams, strict=True):
        comparisons.append(Comparison(i, j, tuple(_rows(measured[i], measured[j], rng))))
        advance(1)
    return _adjust_for_all(comparisons)


def refuse_unlike(runs: Sequence[StoredRun]) -> None:
    """Raise UserError unless all runs answered the same frames and each is named once."""
    first = runs[0].record
    for k, run in enumerate(runs):
        name, record = run.record.name, run.record
        if name in [other.record.name for other in runs[:k]]:
            raise UserError(f"run {name!r} is named twice; name two that differ.")
        asked, other = (
            (r.protocol.id, r.protocol.version, r.protocol.hash) for r in (first, record)
        )
        if asked != other:
            raise UserError(
                f"{first.name} answers {asked[0]}@{asked[1]} ({asked[2][:8]}), but {name} "
                f"{other[0]}@{other[1]} ({other[2][:8]}); runs of one protocol and version can be "
                "compared."
            )
        if canonical(section_key(first)) != canonical(section_key(record)):
            raise UserError(
                f"{first.name} ({measured_on(first)}, {first.data.test:,} test frames) "
                f"and {name} ({measured_on(record)}, {record.data.test:,} test frames) were "
                "not tested on the same frames; a paired comparison needs the same presses: test "
                "both on one sensor with the same options."
            )


def _measure(run: StoredRun) -> _PressMeans:
    spec = protocol_of(run).spec
    trials = trials_of(spec, run.arrays("truth"), run.arrays("predictions"))
    means: dict[Cell, FloatArray] = {}
    for metric in compared_metrics(trials, spec.metrics.names):
        groups = _groups(trials, metric)
        table = press_means(metric, trials, groups)
        means |= {(metric, group): table[:, k] for k, group in enumerate(groups)}
    misses = {m.group: m.value for m in run.record.metrics if m.metric in MISSES}
    return _PressMeans(means, misses, trials.level)


def _groups(trials: AnyTrials, metric: str) -> tuple[str, ...]:
    if isinstance(trials, PlateTrials):
        return tuple(dict.fromkeys(trials.group)) or ("all",)
    if not isinstance(trials, Trials):
        return ("all",)
    if trials.axes:  # hard cases: only the error of each, so that p is adjusted for fewer tests
        cases = [axis.groups for axis in trials.axes] if metric == ERROR else []
        present = set(trials.group)
        return (*(group for groups in cases for group in groups if group in present), "all")
    return tuple(by_kind(trials))


def _rows(
    first: _PressMeans, second: _PressMeans, rng: np.random.Generator
) -> Iterator[MetricComparison]:
    values = {cell: np.concatenate([first.means[cell], second.means[cell]]) for cell in first.means}
    cells = [cell for cell, column in values.items() if np.isfinite(column).any()]
    a, b = (np.stack([side.means[cell] for cell in cells], axis=1) for side in (first, second))
    shared = np.isfinite(a) & np.isfinite(b)
    d = np.where(shared, a - b, 0.0)
    for k, (cell, p) in enumerate(zip(cells, sign_flip_ps(d, rng=rng), strict=True)):
        paired = shared[:, k]
        count = int(paired.sum())
        interval = mean_interval(d[paired, k], np.arange(count), level=first.level)
        yield MetricComparison(
            *cell,
            float(a[paired, k].mean()) if count else None,
            float(b[paired, k].mean()) if count else None,
            interval,
            (
                int((np.isfinite(a[:, k]) & ~paired).sum()),
                int((np.isfinite(b[:, k]) & ~paired).sum()),
            ),
            None if cell[0] in MISSES else _misses(first, second, cell[1]),
            p if count > 1 else None,
        )


def _misses(first: _PressMeans, second: _PressMeans, group: str) -> tuple[float, float] | None:
    """Return ``missed`` or ``coverage`` of a group in both runs; None where a run has none."""
    a, b = first.misses.get(group), second.misses.get(group)
    return None if a is None or b is None else (a, b)


def _adjust_for_all(comparisons: Sequence[Comparison]) -> list[Comparison]:
    """Adjust every p that is shown by Holm's method."""
    adjusted = iter(holm([row.p for pair in comparisons for row in pair.rows if row.p is not None]))
    return [
        replace(
            comparison,
            rows=tuple(
                row if row.p is None else replace(row, p_holm=next(adjusted))
                for row in comparison.rows
            ),
        )
        for comparison in comparisons
    ]


def names_of(runs: Sequence[StoredRun]) -> list[str]:
    """Return a name for each run: model and regime, with the seed or the run's name where equal."""
    labels = [label_of(run.record) for run in runs]
    if len(set(labels)) < len(labels):
        labels = [
            f"{label}, seed {run.record.seed}" for label, run in zip(labels, runs, strict=True)
        ]
    if len(set(labels)) < len(labels):
        return [run.record.name for run in runs]
    return labels


def left_out(runs: Sequence[StoredRun]) -> list[str]:
    """Return the metrics of the protocol that are not means over presses."""
    spec = protocol_of(runs[0]).spec
    field = FIELDS[spec.answer][1]
    metrics = [find_metric(name) for name in spec.metrics.names]
    return [metric.name for metric in metrics if metric.root or getattr(metric, field) is None]


def comparison_rows(
    runs: Sequence[StoredRun], comparisons: Sequence[Comparison]
) -> list[dict[str, Any]]:
    """Return the comparisons as tidy rows, whose ``value`` is first minus second."""
    rows = []
    for comparison in comparisons:
        who = {
            "first": runs[comparison.first].record.name,
            "second": runs[comparison.second].record.name,
        }
        for row in comparison.rows:
            spec, d = find_metric(row.metric), row.difference
            rows.append(
                {
                    **who,
                    "metric": row.metric,
                    "group": row.group,
                    "value": d.value,
                    "low": d.low,
                    "high": d.high,
                    "unit": spec.unit,
                    "better": spec.better,
                    "p": row.p,
                    "p_holm": row.p_holm,
                    "presses": d.clusters,
                    "value_first": row.first,
                    "value_second": row.second,
                    "only_first": row.alone[0],
                    "only_second": row.alone[1],
                }
            )
    return rows
