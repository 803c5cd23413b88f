"""The place of one run: its rank among the rows of a board, and its error over the bound."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tactibench.board.grouping import rows_of, section_key
from tactibench.board.predictions import press_errors_of
from tactibench.board.ranking import ordered, ranks
from tactibench.board.rows import Row
from tactibench.board.submissions import (
    FOLDER,
    all_press_errors,
    compact,
    read_submissions,
    slot,
)
from tactibench.protocols import Ranking, board_spec, version_of
from tactibench.records import Record, StoredRun, canonical

BOUND = "rmse_over_bound"


@dataclass(frozen=True)
class Placement:
    """The place that a run has, or would have, on a board.

    Attributes:
        ranking: The error that orders the board.
        rank: Rank of the run's row; rows that cannot be told apart share one. None: the row has too
            few seeds or presses for a rank.
        rows: Number of rows that have a rank.
        above: The next better row, of another rank where the run has a rank; None for the best.
        board: Folder of the board.
        committed: Whether the run itself is a row of the board already.
    """

    ranking: Ranking
    rank: int | None
    rows: int
    above: Row | None
    board: Path | None = None
    committed: bool = False


def place_run(run: StoredRun, board: Path) -> Placement | None:
    """Return the place of a run among the committed rows of its section.

    The row holds the run and the committed seeds of the same configuration, as the board would
    show it.

    Args:
        run: Stored run.
        board: Folder of the board.

    Returns:
        None where the run has no place: it is partial or learned from fewer presses, no error
        orders the board, or nothing was committed for this sensor and these test frames.

    Raises:
        UserError: A committed record cannot be read.
    """
    record = run.record
    ranking = board_spec(record.protocol.label).ranking
    protocol = version_of(record.protocol.id, record.protocol.hash)
    shortened = record.partial or record.limits.presses is not None
    committed = board / FOLDER / record.protocol.id
    if ranking is None or protocol is None or shortened or not committed.is_dir():
        return None
    all_records = read_submissions(board, record.protocol.id)
    compacted, key = compact(record), canonical(section_key(record))
    others = [
        other
        for other in all_records
        if other.limits.presses is None
        and canonical(section_key(other)) == key
        and slot(other) != slot(compacted)
    ]
    if not others:
        return None
    errors = all_press_errors(board, others)
    truth, predicted = run.arrays("truth"), run.arrays("predictions")
    errors[compacted.name] = press_errors_of(protocol.spec, truth, predicted)
    rows = ordered(record.protocol.label, rows_of([*others, compacted]))
    ranked = ranks(record.protocol.label, rows, errors)
    place = next(k for k, row in enumerate(rows) if compacted in row.records)
    if ranked is None or rows[place].metric(ranking.metric, ranking.group) is None:
        return None
    numbers = ranked.by_row
    rank = numbers[place]
    if rank is None:
        above = place - 1 if place else None
    else:
        better = [k for k, number in enumerate(numbers) if number is not None and number < rank]
        above = max(better, key=lambda k: (numbers[k] or 0, k), default=None)
    ranked_rows = sum(number is not None for number in numbers)
    committed_names = {other.name for other in all_records}
    return Placement(
        ranking=ranking,
        rank=rank,
        rows=ranked_rows,
        above=None if above is None else rows[above],
        board=board,
        committed=compacted.name in committed_names,
    )


def times_bound(record: Record) -> tuple[float, float] | None:
    """Return the smallest and the largest ratio of the RMSE of an axis to its Cramer-Rao bound.

    None where the record holds no such ratio.
    """
    ratios = [m.value for m in record.metrics if m.metric == BOUND and m.value is not None]
    return (min(ratios), max(ratios)) if ratios else None
