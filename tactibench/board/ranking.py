"""The order of a board: by an error that no missing contact can improve, where there is one.

The order is no ranking: whether one row beats another is for a paired comparison (``ranks``).
"""

from __future__ import annotations

from collections.abc import Iterable

from tactibench.board.rows import Row
from tactibench.errors import UserError
from tactibench.protocols.board_spec import Ranking, board_spec
from tactibench.protocols.loader import protocol_files


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
