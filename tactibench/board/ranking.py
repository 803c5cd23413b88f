"""The order of a board's rows, and the ranks that rows share.

Rows are ordered by an error that no missing contact can improve, where there is one. The order is
no ranking: rows that no paired interval over presses tells apart share a rank. Of two rows with
predictions beside all their records the per-press errors, averaged over seeds, are paired on their
common presses, which must be nearly all, and the t interval of their mean difference decides.
Where one has none, the intervals on the board do, and rows are told apart only when these do not
overlap. That never claims too much: the standard deviation of a difference is at most the sum of
the standard deviations, so the paired interval is no wider than both halves together and lies
beyond 0 wherever the two are apart. Seeds are not resampled: a rank says which of these trained
models is better on such presses.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from tactibench.board.predictions import PressErrors
from tactibench.board.rows import PooledMetric, Row
from tactibench.contacts import FloatArray
from tactibench.errors import UserError
from tactibench.protocols.board_spec import Ranking, board_spec
from tactibench.protocols.loader import protocol_files
from tactibench.stats.intervals import mean_interval
from tactibench.stats.paired import grouped


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


def ordered(protocol: str, rows: Iterable[Row]) -> list[Row]:
    """Return rows from the smallest error to the largest, then those without; trivial rows last."""
    return sorted(rows, key=lambda row: (row.trivial, *_place(protocol, row), row.label))


def _place(protocol: str, row: Row) -> tuple[bool, float]:
    ranking = board_spec(protocol).ranking
    pooled = None if ranking is None else row.metric(ranking.metric, ranking.group)
    return (True, 0.0) if pooled is None else (False, pooled.value)


LEVEL = 0.95
SHARED = 0.95
"""Share of the presses of each row that must be common: a row with an error of few presses only
could choose what it is compared on. Models here miss three presses in a thousand."""
Errors = Mapping[str, PressErrors]
"""Per-press errors by the name of the record."""


@dataclass(frozen=True)
class Ranks:
    """by_row: rank of every row, None where it has no error. paired: rows with answers."""

    by_row: tuple[int | None, ...]
    paired: int

    @property
    def note(self) -> str:
        """A sentence on ranks that do not come from paired differences; "" where all do."""
        ranked = sum(rank is not None for rank in self.by_row)
        if self.paired == ranked:
            return ""
        lacking = (
            "No row has"
            if not self.paired
            else (f"{ranked - self.paired} of {ranked} rows do not have")
        )
        return (
            f"{lacking} answers beside all records: there the intervals decide, and "
            "rows share a rank unless these are apart, which tells no more of them apart than "
            "pairing would."
        )


def ranks(protocol: str, rows: Sequence[Row], errors: Errors) -> Ranks | None:
    """Return the ranks of the rows of one section; None for a protocol that no error orders."""
    by = board_spec(protocol).ranking
    if by is None:
        return None
    metrics = [row.metric(by.metric, by.group) for row in rows]
    tables = [_pool_seeds(row, errors) for row in rows]
    values = {k: f.value for k, f in enumerate(metrics) if f is not None and not f.censored}
    # A row without an interval of any kind can be told apart from none, so it has no rank.
    comparable = [k for k in values if tables[k] is not None or _has_interval(metrics[k])]
    order = sorted(comparable, key=lambda k: (values[k], rows[k].label))

    def worse(k: int, best: int) -> bool:
        one, other = tables[k], tables[best]
        if one is not None and other is not None:
            paired = _is_worse_when_paired(one, other)
            if paired is not None:
                return paired
        high, low = (getattr(metrics[i], end) for i, end in ((best, "high"), (k, "low")))
        return high is not None and low is not None and low > high

    by_row = grouped(order, worse)
    paired = sum(tables[k] is not None for k in order)
    return Ranks(tuple(by_row.get(k) for k in range(len(rows))), paired)


def _has_interval(pooled: PooledMetric | None) -> bool:
    return pooled is not None and pooled.low is not None and pooled.high is not None


def _is_worse_when_paired(one: PressErrors, other: PressErrors) -> bool | None:
    """Return whether the first is worse on the presses of both; None where these are too few."""
    if one.press is other.press:  # of one test set, see ``all_press_errors``
        return _is_positive(one.error - other.error)
    shared, i, j = np.intersect1d(one.press, other.press, return_indices=True)
    if len(shared) < SHARED * max(len(one.press), len(other.press)):
        return None
    return _is_positive(one.error[i] - other.error[j])


def _is_positive(difference: FloatArray) -> bool:
    """Return whether the mean of a difference is surely above 0."""
    low = mean_interval(difference, np.arange(len(difference)), level=LEVEL).low
    return low is not None and low > 0


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
