"""The order of a board's rows, and the ranks that each of them may have.

Rows are ordered by an error that no missing contact can improve, where there is one. The order is
no ranking: chance may have made it, that of other presses and of other training seeds (see
``stats.crossed_p_values``, with the sources). So a row has an interval of ranks: from 1 + the
number of rows that are significantly better to K - the number of rows that are significantly worse,
K being the number of ranked rows.

Presses: two rows are compared press by press. Their errors of each press, averaged over seeds, are
paired on the common presses. Rows that do not have nearly all presses in common are compared as
independent samples. A row with a record without errors of its presses has no rank.

Seeds: the spread of each row's own seeds. A model that draws nothing at random when it is trained
has no spread, and one seed of it is enough (``ModelSpec``, ``tactibench check``); seeds with the
same weights count once.

Errors are compared as ratios (differences of logarithms, their variances by the delta method):
seeds scatter an error by a share of it, so that a model with ten times the error scatters by ten
times as much.

The p values of all pairs of a table are adjusted together, so that 5 % of the pairs that are called
different are not (Benjamini and Hochberg 1995). Holm's adjustment, which allows one such pair in
twenty tables, calls 10 % of the pairs different that differ by 30 %, in place of 72 %
(benchmarks/rank_intervals.py).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tactibench.board.rows import Row, draws_nothing
from tactibench.board.submissions import PressErrors
from tactibench.contacts import FloatArray
from tactibench.errors import UserError
from tactibench.protocols import (
    LoadedProtocol,
    Ranking,
    board_spec,
    load_protocol,
    protocol_files,
)
from tactibench.stats import adjust_pairs, crossed_p_values

Pairs = tuple[list[int], list[int], npt.NDArray[np.intp], npt.NDArray[np.intp]]


def ranking_error(protocol: str) -> Ranking:
    """Return the error that orders the board of a protocol.

    Raises:
        UserError: No error orders the board.
    """
    ranking = board_spec(protocol).ranking
    if ranking is None:
        able = ", ".join(name for name in protocol_files() if board_spec(name).ranking)
        raise UserError(f"no error of {protocol} orders its board; take {able}.")
    return ranking


def unseen_error(protocol: LoadedProtocol) -> Ranking | None:
    """Return the error on sensors that no training saw; None where the protocol tests none."""
    spec = board_spec(protocol.spec.id)
    tests = (test.name for test in protocol.spec.test.apart if test.instances)
    return next((spec.apart[name] for name in tests if name in spec.apart), None)


def ordered(protocol: str, rows: Iterable[Row], apart: str = "") -> list[Row]:
    """Return rows from the smallest error to the largest, then those without; trivial rows last.

    Args:
        protocol: Name of the protocol.
        rows: Rows of one section.
        apart: Name of the test scored apart whose error orders the rows; "": the main test.
    """
    by = _ranking(protocol, apart)

    def place(row: Row) -> tuple[bool, bool, float, str]:
        pooled = None if by is None else row.metric(by.metric, by.group)
        return row.trivial, pooled is None, 0.0 if pooled is None else pooled.value, row.label

    return sorted(rows, key=place)


def _ranking(protocol: str, apart: str) -> Ranking | None:
    spec = board_spec(protocol)
    return spec.apart.get(apart) if apart else spec.ranking


LEVEL = 0.95
SHARED = 0.95
"""Share of the presses of each row that must be common: else a row with errors of a few presses
could choose what it is compared on. Models on the boards miss three presses in a thousand."""
FEWEST_PRESSES = 20
"""Fewest presses for a rank: with fewer the variance is off by a third or more, and one press may
decide."""
FEWEST_SENSORS = 5
"""Fewest sensors for a rank by an error on several: with four the interval is half as wide again as
with eight."""
FEWEST_SEEDS = 3
"""Fewest seeds for a rank: the standard deviation of two is off by three quarters."""
EQUAL = 1e-12
"""Relative difference below which two numbers differ by rounding alone."""
SMALLEST_MM = 1e-9
"""Smaller errors are set to this value, because zero has no logarithm."""
Errors = Mapping[str, PressErrors]
"""Per-press errors by the name of the record."""


class RankInterval(NamedTuple):
    """The best and the worst rank that a row may have."""

    best: int
    worst: int

    def __str__(self) -> str:
        return f"{self.best}" if self.best == self.worst else f"{self.best}–{self.worst}"


@dataclass(frozen=True)
class Ranks:
    """The ranks of a table.

    Attributes:
        by_row: Ranks of every row, None where it has none.
        too_few: Number of rows with an error, but too few presses, sensors or seeds for a rank.
        fewest: Fewest presses or sensors for a rank.
    """

    by_row: tuple[RankInterval | None, ...]
    too_few: int
    fewest: int

    @property
    def note(self) -> str:
        """Sentence on the rows without a rank; "" for none."""
        if not self.too_few:
            return ""
        count = "1 row has" if self.too_few == 1 else f"{self.too_few} rows have"
        return (
            f"{count} no rank: fewer than {self.fewest} presses or sensors, or fewer than "
            f"{FEWEST_SEEDS} seeds of a model that may draw at random when it is trained."
        )


def ranks(protocol: str, rows: Sequence[Row], errors: Errors, apart: str = "") -> Ranks | None:
    """Return the ranks of the rows of one section; None for a protocol that no error orders.

    Args:
        protocol: Name of the protocol.
        rows: Rows of the section.
        errors: Errors press by press, by the name of the record.
        apart: Name of the test scored apart whose error ranks the rows; "": the main test.
    """
    by = _ranking(protocol, apart)
    if by is None:
        return None
    if apart:
        errors = {
            name: of_record.apart[apart]
            for name, of_record in errors.items()
            if apart in of_record.apart
        }
    fewest = _fewest(protocol, apart)
    samples = [_sample(row, by, errors) for row in rows]
    enough = [(k, sample) for k, sample in enumerate(samples) if sample and sample.enough(fewest)]
    places = rank_intervals(*_compare([sample for _, sample in enough]))
    by_row = {k: place for (k, _), place in zip(enough, places, strict=True)}
    return Ranks(
        tuple(by_row.get(k) for k in range(len(rows))),
        sum(sample is not None and not sample.enough(fewest) for sample in samples),
        fewest,
    )


def _fewest(protocol: str, apart: str) -> int:
    """Return the fewest presses of the main test, or sensors of a test on several, for a rank."""
    tests = load_protocol(protocol).spec.test.apart if apart else ()
    on_sensors = any(test.name == apart and test.instances for test in tests)
    return FEWEST_SENSORS if on_sensors else FEWEST_PRESSES


def rank_intervals(difference: FloatArray, p: FloatArray) -> list[RankInterval]:
    """Return the ranks that each of K samples may have.

    Args:
        difference: (K, K) differences of log errors, row minus column.
        p: (K, K) their p values, not adjusted.
    """
    distinct = adjust_pairs(p) < 1 - LEVEL
    better, worse = ((distinct & (difference * sign > 0)).sum(axis=1) for sign in (1, -1))
    count = len(difference)
    return [RankInterval(1 + int(b), count - int(w)) for b, w in zip(better, worse, strict=True)]


@dataclass(frozen=True, eq=False)
class _Sample:
    """The error of a row, and everything by which it may be off.

    Attributes:
        value: Mean over seeds.
        seeds: Number of trainings; 0 where a training draws nothing at random.
        seed_variance: Variance of the mean over seeds.
        errors: Errors press by press, means over seeds.
    """

    value: float
    seeds: int
    seed_variance: float
    errors: PressErrors

    @property
    def presses(self) -> int:
        """Number of presses, or of sensors."""
        return len(self.errors.press)

    def enough(self, fewest: int) -> bool:
        """Return whether there are enough presses, or sensors, and seeds for a rank."""
        return self.presses >= fewest and (not self.seeds or self.seeds >= FEWEST_SEEDS)


def _sample(row: Row, by: Ranking, errors: Errors) -> _Sample | None:
    """Return the sample of a row; None where it has no error, or none press by press."""
    pooled, errors_of_row = row.metric(by.metric, by.group), _pool_seeds(row, errors)
    if pooled is None or pooled.censored or errors_of_row is None:
        return None
    # Seeds with one weights hash are one training, whatever they are called.
    trainings = {record.identity.weights_hash: record for record in row.records}
    values = [record.value(by.metric, by.group) for record in trainings.values()]
    seed_values = [value for value in values if value is not None]
    answers = {record.identity.predictions_hash for record in row.records}
    one_answer = len(row.records) >= FEWEST_SEEDS and len(answers) == 1
    drawn = len(trainings) > 1 or not (one_answer or draws_nothing(row.first))
    variance = (
        float(np.var(seed_values, ddof=1)) / len(seed_values) if len(seed_values) > 1 else 0.0
    )
    return _Sample(pooled.value, len(trainings) if drawn else 0, variance, errors_of_row)


def _compare(samples: Sequence[_Sample]) -> tuple[FloatArray, FloatArray]:
    """Return the differences of log errors, row minus column, and their p values.

    Returns:
        Two (K, K) arrays.
    """
    value = np.array([max(sample.value, SMALLEST_MM) for sample in samples])
    presses = np.array([float(sample.presses) for sample in samples])
    own = [np.var(sample.errors.error, ddof=1) / sample.presses for sample in samples] / value**2
    difference = np.log(value)[:, None] - np.log(value)
    variance, counts = own[:, None] + own, np.minimum(presses[:, None], presses)
    for rows, columns, i, j in _shared_presses(samples):
        block, mirrored = np.ix_(rows, columns), np.ix_(columns, rows)
        errors = np.array([samples[k].errors.error[i] for k in rows])
        other = np.array([samples[k].errors.error[j] for k in columns])
        apart, spread = _ratios(errors, other)
        difference[block], difference[mirrored] = apart, -apart.T
        variance[block], variance[mirrored] = spread, spread.T
        counts[block], counts[mirrored] = errors.shape[1], errors.shape[1]
    p = crossed_p_values(
        difference,
        variance,
        counts,
        np.array([sample.seed_variance for sample in samples]) / value**2,
        np.array([float(sample.seeds) for sample in samples]),
    )
    return difference, p


def _ratios(one: FloatArray, other: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the differences of the logarithms of mean errors, and their variances.

    Differences and variances no larger than rounding are 0.

    Args:
        one: (K, P) errors of K samples on P presses.
        other: (L, P) errors of L samples on the same presses.

    Returns:
        Two (K, L) arrays.
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


def _shared_presses(samples: Sequence[_Sample]) -> Iterator[Pairs]:
    """Yield pairs of groups of samples, and the places of their common presses in each.

    All samples of a group have the same presses. Pairs with too few common presses are left out.
    """
    groups: dict[int, list[int]] = {}
    for k, sample in enumerate(samples):
        groups.setdefault(id(sample.errors.press), []).append(k)
    members = list(groups.values())
    names = [samples[group[0]].errors.press for group in members]
    for g, rows in enumerate(members):
        everything = np.arange(len(names[g]))
        yield rows, rows, everything, everything
        for h in range(g):
            shared, i, j = np.intersect1d(names[g], names[h], return_indices=True)
            if len(shared) >= SHARED * max(len(names[g]), len(names[h])):
                yield rows, members[h], i, j


def _pool_seeds(row: Row, errors: Errors) -> PressErrors | None:
    """Return the mean over seeds of the presses that all seeds have.

    None where a seed has no answers, or where the seeds share too few presses.
    """
    per_record = [errors.get(record.name) for record in row.records]
    seeds = [seed for seed in per_record if seed is not None]
    if not seeds or len(seeds) < len(per_record):
        return None
    if all(seed.press is seeds[0].press for seed in seeds):
        return PressErrors(seeds[0].press, np.mean([seed.error for seed in seeds], axis=0))
    shared = reduce(np.intersect1d, [seed.press for seed in seeds])
    if len(shared) < SHARED * max(len(seed.press) for seed in seeds):
        return None
    columns: list[FloatArray] = [seed.error[np.isin(seed.press, shared)] for seed in seeds]
    return PressErrors(shared, np.mean(columns, axis=0))
