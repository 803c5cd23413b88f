"""The error that orders a board: one that no missing contact can improve, where there is one.

The order is no ranking: whether one row beats another is for a paired comparison (``ranks``).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from tactibench.board.rows import Row
from tactibench.errors import UserError


@dataclass(frozen=True)
class RankingError:
    """A metric of which less is better. name: in sentences and on axes."""

    metric: str
    group: str
    name: str
    decimals: int
    unit: str = "mm"


RANKING = {
    "exp1": RankingError("mae_mm", "mean", "MAE, mean of x, y and depth", 4),
    "exp2": RankingError("distance_penalised_mm", "all", "penalised distance error", 3),
    "exp3": RankingError("gospa1_mm", "all", "GOSPA (p = 1), all frames", 3),
    "stability": RankingError("ospa_mm", "all", "OSPA (p = 1), all cases", 3),
    "surface": RankingError("depth_mae_mm", "all", "depth MAE", 4),
    "transfer": RankingError("depth_mae_mm", "0", "indentation MAE without labelled frames", 3),
}
"""exp1 scores the best prediction without a gate, so that a poor one cannot hide as a miss; surface
and transfer have no such metric, and coverage stands beside it."""


def ranking_error(protocol: str) -> RankingError:
    """The error that orders the board of a protocol. Raises UserError where none does."""
    if protocol not in RANKING:
        raise UserError(f"no error of {protocol} orders its board; take {', '.join(RANKING)}.")
    return RANKING[protocol]


def ordered(protocol: str, rows: Iterable[Row]) -> list[Row]:
    """Rows from the smallest error to the largest, then those without; trivial rows last."""
    return sorted(rows, key=lambda row: (row.trivial, *_place(protocol, row), row.label))


def _place(protocol: str, row: Row) -> tuple[bool, float]:
    if protocol not in RANKING:
        return True, 0.0
    by = RANKING[protocol]
    found = row.metric(by.metric, by.group)
    return (True, 0.0) if found is None else (False, found.value)
