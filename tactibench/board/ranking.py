"""The order of a board's rows, and the ranks that rows share.

Rows are ordered by an error that no missing contact can improve, where there is one. The order is
no ranking: a rank is shared by rows that chance alone may have ordered, the chance of other presses
and of other training seeds (see ``stats.crossed``, with the sources).

Presses: of two rows with predictions beside all their records the per-press errors, averaged over
seeds, are paired on their common presses, which must be nearly all. Where one has none, the
intervals on the board stand for them. That never claims too much: the standard deviation of a
difference is at most the sum of the two.

Seeds: the spread of the rows' own. A model that draws nothing when it is trained has none, and one
seed of it is enough. That is believed of models that ship with tactibench (``ModelSpec``,
``tactibench check``), not of a stranger's; seeds of one weights hash count once.

Errors are compared as ratios (differences of logarithms, their variances by the delta method):
seeds scatter an error by a share of it, so that a model with ten times the error scatters by ten
times as much.

Two adjustments (Holm): the p values of presses and seeds for the comparisons that the ranks make,
of the first row of a group with all that are left; those of presses alone for all pairs of the
table, because which row is the first is decided by the same numbers. With the former alone up to
15 % of the tables of twelve equal models were split at 5 %, with both 2 to 7 %. All pairs for both
would be safe, but then no three seeds could tell an error from its tenfold.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
import numpy.typing as npt

from tactibench.board.predictions import PressErrors
from tactibench.board.rows import Row, trained_on
from tactibench.board.shipped import deterministic_models
from tactibench.contacts import FloatArray
from tactibench.errors import UserError
from tactibench.protocols.board_spec import Ranking, board_spec
from tactibench.protocols.loader import protocol_files
from tactibench.stats.crossed import adjust_pairs, crossed_interval, crossed_p_values
from tactibench.stats.intervals import t_quantile
from tactibench.stats.paired import grouped, holm

Pairs = tuple[list[int], list[int], npt.NDArray[np.intp], npt.NDArray[np.intp]]


def ranking_error(protocol: str) -> Ranking:
    """Return the error that orders the board of a protocol.

    Raises:
        UserError: No error orders it.
    """
    ranking = board_spec(protocol).ranking
    if ranking is None:
        ordered_boards = [name for name in protocol_files() if board_spec(name).ranking]
        raise UserError(
            f"no error of {protocol} orders its board; take {', '.join(ordered_boards)}."
        )
    return ranking


def ordered(protocol: str, rows: Iterable[Row], apart: str = "") -> list[Row]:
    """Return rows from the smallest error to the largest, then those without; trivial rows last.

    apart: name of the test that is scored apart whose error orders them; "": the main test.
    """
    ranking = _ranking(protocol, apart)
    return sorted(rows, key=lambda row: (row.trivial, *_place(ranking, row), row.label))


def _ranking(protocol: str, apart: str) -> Ranking | None:
    spec = board_spec(protocol)
    return spec.apart.get(apart) if apart else spec.ranking


def _place(ranking: Ranking | None, row: Row) -> tuple[bool, float]:
    pooled = None if ranking is None else row.metric(ranking.metric, ranking.group)
    return (True, 0.0) if pooled is None else (False, pooled.value)


LEVEL = 0.95
SHARED = 0.95
"""Share of the presses of each row that must be common: a row with an error of few presses only
could choose what it is compared on. Models here miss three presses in a thousand."""
FEWEST_PRESSES = 20
"""Presses for a rank: the variance of fewer is off by a third and more, and one press decides."""
FEWEST_SEEDS = 3
"""Seeds for a rank: the standard deviation of two is off by three quarters."""
EQUAL = 1e-12
"""Share of two numbers below which their difference is rounding."""
SMALLEST_MM = 1e-9
"""Errors below this are this: zero has no logarithm."""
Errors = Mapping[str, PressErrors]
"""Per-press errors by the name of the record."""


@dataclass(frozen=True)
class Ranks:
    """The ranks of a table.

    Attributes:
        by_row: Rank of every row, None where it has none.
        paired: How many rows of those with a rank have predictions beside all records.
        too_few: How many rows have an error, but too few presses or seeds for a rank.
    """

    by_row: tuple[int | None, ...]
    paired: int
    too_few: int = 0

    @property
    def note(self) -> str:
        """Sentences on what the page does not say of all ranks; "" where there is nothing."""
        sentences = []
        if self.too_few:
            count = "1 row has" if self.too_few == 1 else f"{self.too_few} rows have"
            sentences.append(
                f"{count} no rank: fewer than {FEWEST_PRESSES} presses, or fewer than "
                f"{FEWEST_SEEDS} seeds of a model that draws at random when it is trained."
            )
        ranked = sum(rank is not None for rank in self.by_row)
        if self.paired < ranked:
            lacking = "No row has" if not self.paired else f"Of {ranked} rows {self.paired} have"
            sentences.append(
                f"{lacking} predictions beside all records. For the others the intervals stand, "
                "which tell no more rows apart than paired presses would."
            )
        return " ".join(sentences)


@dataclass(frozen=True)
class RowDifference:
    """The error of one row minus that of another, with its 95 % interval over presses and seeds.

    Values are in the unit of the error that orders the board. presses: that both answered.
    """

    value: float
    low: float
    high: float
    presses: int


def row_difference(protocol: str, first: Row, second: Row, errors: Errors) -> RowDifference | None:
    """Return the difference of the error that orders a board, first minus second, press by press.

    None where one of the rows has no errors of its presses, or too few seeds to know their spread.

    Args:
        protocol: Of both rows.
        first: A row.
        second: A row of the same section.
        errors: Press by press, by the name of the record.
    """
    by = _ranking(protocol, "")
    if by is None:
        return None
    found = [_sample(row, by, errors) for row in (first, second)]
    samples = [one for one in found if one is not None and one.errors is not None and one.enough]
    if len(samples) < 2:
        return None
    one, other = (_errors(sample) for sample in samples)
    shared, i, j = np.intersect1d(one.press, other.press, return_indices=True)
    if len(shared) < SHARED * max(len(one.press), len(other.press)):
        return None
    difference = one.error[i] - other.error[j]
    mean = float(difference.mean())
    presses = float(np.var(difference, ddof=1)) / len(shared), len(shared) - 1.0
    seeds = [(sample.seed_variance, sample.seeds - 1.0) for sample in samples if sample.seeds]
    low, high = crossed_interval(mean, presses, seeds, LEVEL)
    return RowDifference(mean, low, high, len(shared))


def ranks(protocol: str, rows: Sequence[Row], errors: Errors, apart: str = "") -> Ranks | None:
    """Return the ranks of the rows of one section; None for a protocol that no error orders.

    apart: name of the test that is scored apart whose error ranks them; "": the main test.
    """
    by = _ranking(protocol, apart)
    if by is None:
        return None
    if apart:
        errors = {name: own.apart[apart] for name, own in errors.items() if apart in own.apart}
    samples = [_sample(row, by, errors) for row in rows]
    enough = [(k, sample) for k, sample in enumerate(samples) if sample and sample.enough]
    enough.sort(key=lambda one: (one[1].value, rows[one[0]].label))
    ranked = [sample for _, sample in enough]
    places = _group(*_compare(ranked))
    by_row = {enough[place][0]: rank for place, rank in places.items()}
    return Ranks(
        tuple(by_row.get(k) for k in range(len(rows))),
        sum(sample.errors is not None for sample in ranked),
        sum(sample is not None and not sample.enough for sample in samples),
    )


@dataclass(frozen=True, eq=False)
class _Sample:
    """The error of a row, and all by which it may be off.

    Attributes:
        value: The mean over seeds.
        below: Standard error towards smaller values, of the presses, from the interval.
        above: The same towards larger ones.
        presses: Number of presses.
        seeds: Number of trainings; 0 where nothing of them is drawn.
        seed_variance: Of the mean over seeds.
        errors: Press by press, means over seeds; None without predictions of all seeds.
    """

    value: float
    below: float
    above: float
    presses: int
    seeds: int
    seed_variance: float
    errors: PressErrors | None

    @property
    def enough(self) -> bool:
        """Return whether there are enough presses and seeds for a rank."""
        return self.presses >= FEWEST_PRESSES and (not self.seeds or self.seeds >= FEWEST_SEEDS)


def _group(difference: FloatArray, of_presses: FloatArray, of_both: FloatArray) -> dict[int, int]:
    """Return the rank of every sample, the best first; the arguments are those of ``_compare``."""
    distinct = (adjust_pairs(of_presses) < 1 - LEVEL) & (difference > 0)

    def worse(first: int, others: Sequence[int]) -> set[int]:
        adjusted = holm([float(of_both[k, first]) for k in others])
        pairs = zip(others, adjusted, strict=True)
        return {k for k, p in pairs if p < 1 - LEVEL and distinct[k, first]}

    return grouped(range(len(difference)), worse)


def _sample(row: Row, by: Ranking, errors: Errors) -> _Sample | None:
    """Return the sample of a row; None where it has no error, or nothing to tell it apart by."""
    pooled = row.metric(by.metric, by.group)
    if pooled is None or pooled.censored:
        return None
    paired = _pool_seeds(row, errors)
    if paired is None and (pooled.low is None or pooled.high is None):
        return None
    presses = pooled.clusters[0] if paired is None else len(paired.press)
    low = pooled.value if pooled.low is None else pooled.low
    high = pooled.value if pooled.high is None else pooled.high
    t = t_quantile(LEVEL, max(presses, 2))
    # Seeds with one weights hash are one training, whatever they are called.
    trainings = {record.identity.weights_hash: record for record in row.records}
    values = [record.value(by.metric, by.group) for record in trainings.values()]
    known = [value for value in values if value is not None]
    drawn = len(trainings) > 1 or not draws_nothing(row)
    variance = float(np.var(known, ddof=1)) / len(known) if len(known) > 1 else 0.0
    return _Sample(
        value=pooled.value,
        below=(pooled.value - low) / t,
        above=(high - pooled.value) / t,
        presses=presses,
        seeds=len(trainings) if drawn else 0,
        seed_variance=variance,
        errors=paired,
    )


def draws_nothing(row: Row) -> bool:
    """Return whether a training of the row draws nothing, as far as that is believed.

    A training for another sensor may draw how sensors differ (``kernel`` does).
    """
    return row.first.model.name in deterministic_models() and not trained_on(row.first)


def _compare(samples: Sequence[_Sample]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return (K, K) differences of log errors, row minus column, and their p values.

    These are of presses alone, and of presses and seeds.
    """
    value = np.array([max(sample.value, SMALLEST_MM) for sample in samples])
    below = np.array([sample.below for sample in samples]) / value
    above = np.array([sample.above for sample in samples]) / value
    presses = np.array([float(sample.presses) for sample in samples])
    difference = np.log(value)[:, None] - np.log(value)
    # The ends that face each other: low of the larger error, high of the smaller.
    facing = np.where(difference > 0, below[:, None] + above, above[:, None] + below)
    variance, counts = facing**2, np.minimum(presses[:, None], presses)
    for rows, columns, i, j in _shared_presses(samples):
        here, there = np.ix_(rows, columns), np.ix_(columns, rows)
        errors = np.array([_errors(samples[k]).error[i] for k in rows])
        other = np.array([_errors(samples[k]).error[j] for k in columns])
        apart, spread = _ratios(errors, other)
        difference[here], difference[there] = apart, -apart.T
        variance[here], variance[there] = spread, spread.T
        counts[here], counts[there] = errors.shape[1], errors.shape[1]
    of_presses, of_both = crossed_p_values(
        difference,
        variance,
        counts,
        np.array([sample.seed_variance for sample in samples]) / value**2,
        np.array([float(sample.seeds) for sample in samples]),
    )
    return difference, of_presses, of_both


def _ratios(one: FloatArray, other: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return differences of the logarithms of mean errors of (K, P) and (L, P), and variances.

    What is no more than rounding is 0.
    """
    mean, other_mean = (
        np.maximum(errors.mean(axis=1, keepdims=True), SMALLEST_MM) for errors in (one, other)
    )
    a, b = one / mean, other / other_mean
    a, b = a - a.mean(axis=1, keepdims=True), b - b.mean(axis=1, keepdims=True)
    size = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1)
    spread = size - 2 * (a @ b.T)
    spread[spread < EQUAL * size] = 0.0
    difference = np.log(mean) - np.log(other_mean).T
    difference[np.abs(difference) < EQUAL] = 0.0
    presses = one.shape[1]
    return difference, spread / max(presses - 1, 1) / presses


def _errors(sample: _Sample) -> PressErrors:
    assert sample.errors is not None  # noqa: S101 - only those are asked for
    return sample.errors


def _shared_presses(samples: Sequence[_Sample]) -> Iterator[Pairs]:
    """Yield two groups of samples, each of the same presses, and which of them both have.

    Groups that share too few are left out.
    """
    groups: dict[int, list[int]] = {}
    for k, sample in enumerate(samples):
        if sample.errors is not None:
            groups.setdefault(id(sample.errors.press), []).append(k)
    members = list(groups.values())
    names = [_errors(samples[group[0]]).press for group in members]
    for g, rows in enumerate(members):
        everything = np.arange(len(names[g]))
        yield rows, rows, everything, everything
        for h in range(g):
            shared, i, j = np.intersect1d(names[g], names[h], return_indices=True)
            if len(shared) >= SHARED * max(len(names[g]), len(names[h])):
                yield rows, members[h], i, j


def _pool_seeds(row: Row, errors: Errors) -> PressErrors | None:
    """Return the mean over seeds of presses that all have.

    None where a seed has no answers, or where the seeds share too few presses.
    """
    known = [errors.get(record.name) for record in row.records]
    seeds = [one for one in known if one is not None]
    if not seeds or len(seeds) < len(known):
        return None
    if all(one.press is seeds[0].press for one in seeds):
        return PressErrors(seeds[0].press, np.mean([one.error for one in seeds], axis=0))
    shared = reduce(np.intersect1d, [one.press for one in seeds])
    if len(shared) < SHARED * max(len(one.press) for one in seeds):
        return None
    columns: list[FloatArray] = [one.error[np.isin(one.press, shared)] for one in seeds]
    return PressErrors(shared, np.mean(columns, axis=0))
