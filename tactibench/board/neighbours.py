"""The place of a submission among the committed records beside it.

Nobody can derive the hash of test frames without making the frames, so that an invented hash opens
a table of its own. A submission that names a model that ships joins its row. The verdict says
both, for the reviewer who merges it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from tactibench.board.grouping import row_key, section_key
from tactibench.board.submissions import read_untrusted
from tactibench.errors import UserError
from tactibench.records import Record, canonical, parse_record


@dataclass(frozen=True)
class Neighbours:
    """The committed records of one protocol beside a submission.

    Attributes:
        row: Training seeds of the row that it joins; empty where it begins one.
        table: Number of records in its table.
        other_frames: Number of records of the same test on the same sensor that state another hash
            of the test frames.
    """

    row: tuple[int, ...]
    table: int
    other_frames: int

    @property
    def note(self) -> str:
        """A clause on the place of the submission."""
        seeds = ", ".join(map(str, self.row))
        row = f"joins the row with seed {seeds}" if self.row else "begins a row"
        if self.table:
            return f"{row}, in a table with {self.table:,} other records"
        if not self.other_frames:
            return f"{row}, in a new table"
        return (
            f"{row}, in a table of its own: {self.other_frames:,} records of this test state "
            "another hash of its frames"
        )


def find_neighbours(record: Record, path: Path) -> Neighbours:
    """Return the place of a submission among the records in its folder.

    Args:
        record: Record of the submission.
        path: Its file.

    Raises:
        UserError: Another file holds the same row and seed, or its name differs only in capitals,
            so that some file systems take both for one file.
    """
    for file in path.parent.glob("*.json"):
        if file.stem != path.stem and file.stem.casefold() == path.stem.casefold():
            raise UserError(
                f"{path} and {file.name} differ in capitals alone, which some systems take for "
                "one file; rename the model, or run it with another seed."
            )
    row, table, key = canonical(row_key(record)), canonical(section_key(record)), _test(record)
    seeds: list[int] = []
    same_table = same_test = 0
    for other in _records_beside(path):
        same_table += canonical(section_key(other)) == table
        same_test += _test(other) == key
        if canonical(row_key(other)) != row:
            continue
        seeds.append(other.seed)
        if other.seed == record.seed:
            raise UserError(
                f"{path} is seed {record.seed} of a row that has it from {other.name}; remove that "
                "record with it (`tactibench board submit` does), or take another seed."
            )
    return Neighbours(tuple(sorted(seeds)), same_table, same_test - same_table)


def _records_beside(path: Path) -> Iterator[Record]:
    """Yield the other records in a folder, without unreadable ones, which get their own verdict."""
    for other in sorted(path.parent.glob("*.json")):
        if other.stem == path.stem:
            continue
        with suppress(UserError):
            yield parse_record(read_untrusted(other), str(other))


def _test(record: Record) -> str:
    return canonical(section_key(record, frames=False))
