"""The order of a board's rows, and the ranks that rows share.

Rows are ordered by an error that no missing contact can improve, where there is one. The order is
no ranking: rows share a rank where chance alone may have ordered them, the chance of other presses
and of other training seeds (see ``stats.crossed``, with the sources).

Presses: two rows are compared press by press. Their errors of each press, averaged over seeds, are
paired on the common presses. Rows that do not have nearly all presses in common are compared as
independent samples. A row with a record without errors of its presses has no rank.

Seeds: the spread of each row's own seeds. A model that draws nothing at random when it is trained
has no spread, and one seed of it is enough (``ModelSpec``, ``tactibench check``); seeds with the
same weights count once.

Errors are compared as ratios (differences of logarithms, their variances by the delta method):
seeds scatter an error by a share of it, so that a model with ten times the error scatters by ten
times as much.

Two adjustments (Holm). The p values of presses and seeds are adjusted for the comparisons that the
ranks make: the first row of a group with all rows that are left. The p values of presses alone are
adjusted for all pairs of the table, because the same numbers decide which row is the first. With
the first adjustment alone, up to 15 % of the tables of twelve equal models were split at 5 %, with
both 2 to 7 %. Adjusting both for all pairs would be safe, but then three seeds could not even tell
an error from one ten times as large.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
import numpy.typing as npt

from tactibench.board.rows import Row, draws_nothing
from tactibench.board.submissions import PressErrors
from tactibench.contacts import FloatArray
from tactibench.errors import UserError
from tactibench.protocols import Ranking, board_spec, protocol_files
from tactibench.stats import (
    adjust_pairs,
    crossed_p_values,
    grouped,
    holm,
)

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
FEWEST_SEEDS = 3
"""Fewest seeds for a rank: the standard deviation of two is off by three quarters."""
EQUAL = 1e-12
"""Relative difference below which two numbers differ by rounding alone."""
SMALLEST_MM = 1e-9
"""Smaller errors are set to this value, because zero has no logarithm."""
Errors = Mapping[str, PressErrors]
"""Per-press errors by the name of the record."""


@dataclass(frozen=True)
class Ranks:
    """The ranks of a table.

    Attributes:
        by_row: Rank of every row, None where it has none.
        too_few: Number of rows that have an error, but too few presses or seeds for a rank.
        unsure: Rows that cannot be told apart from the first row of their rank, although a row with
            a smaller error can. Their errors scatter more, as a rule.
    """

    by_row: tuple[int | None, ...]
    too_few: int = 0
    unsure: frozenset[int] = frozenset()

    @property
    def note(self) -> str:
        """Sentence on the rows without a rank; "" for none."""
        if not self.too_few:
            return ""
        count = "1 row has" if self.too_few == 1 else f"{self.too_few} rows have"
        return (
            f"{count} no rank: fewer than {FEWEST_PRESSES} presses, or fewer than "
            f"{FEWEST_SEEDS} seeds of a model that draws at random when it is trained."
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
    samples = [_sample(row, by, errors) for row in rows]
    enough = [(k, sample) for k, sample in enumerate(samples) if sample and sample.enough]
    enough.sort(key=lambda one: (one[1].value, rows[one[0]].label))
    ranked = [sample for _, sample in enough]
    places = _group(*_compare(ranked))
    by_row = {enough[place][0]: rank for place, rank in places.items()}
    latest = np.maximum.accumulate([places[place] for place in range(len(ranked))])
    return Ranks(
        tuple(by_row.get(k) for k in range(len(rows))),
        sum(sample is not None and not sample.enough for sample in samples),
        frozenset(enough[place][0] for place, rank in places.items() if rank < latest[place]),
    )


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
        """Number of presses."""
        return len(self.errors.press)

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
    """Return the sample of a row; None where it has no error, or none press by press."""
    pooled, errors_of_row = row.metric(by.metric, by.group), _pool_seeds(row, errors)
    if pooled is None or pooled.censored or errors_of_row is None:
        return None
    # Seeds with one weights hash are one training, whatever they are called.
    trainings = {record.identity.weights_hash: record for record in row.records}
    values = [record.value(by.metric, by.group) for record in trainings.values()]
    seed_values = [value for value in values if value is not None]
    drawn = len(trainings) > 1 or not draws_nothing(row.first)
    variance = (
        float(np.var(seed_values, ddof=1)) / len(seed_values) if len(seed_values) > 1 else 0.0
    )
    return _Sample(pooled.value, len(trainings) if drawn else 0, variance, errors_of_row)


def _compare(samples: Sequence[_Sample]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the differences of log errors, row minus column, and their p values.

    Returns:
        Three (K, K) arrays: the differences, the p values of presses alone, and the p values of
        presses and seeds.
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
    of_presses, of_both = crossed_p_values(
        difference,
        variance,
        counts,
        np.array([sample.seed_variance for sample in samples]) / value**2,
        np.array([float(sample.seeds) for sample in samples]),
    )
    return difference, of_presses, of_both


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
