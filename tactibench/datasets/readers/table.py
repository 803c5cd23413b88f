"""Tables of labels: every cell as text, so that an error can show it as it stands.

Cells are separated by commas, semicolons or tabs, whichever the header has most of. Decimal commas
are read where the columns are separated by something else and no cell has a decimal point.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactibench.errors import UserError

FloatArray = npt.NDArray[np.float64]

_SEPARATORS = ",;\t"
_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*", re.ASCII)
_COMMA_NUMBER = re.compile(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*")
_POINT_NUMBER = re.compile(r"\s*[+-]?\d*\.\d+([eE][+-]?\d+)?\s*")


@dataclass(frozen=True, eq=False)
class Table:
    """A table of texts. Rows are counted from 1 below the header.

    Attributes:
        path: The file, for errors.
        cells: Column -> texts, all of the same length.
        comma: Whether numbers have decimal commas.
        header: Whether the names of the columns stand in the file; else they are column_1 ....
    """

    path: Path
    cells: Mapping[str, Sequence[str]]
    comma: bool = False
    header: bool = True

    def __len__(self) -> int:
        return len(next(iter(self.cells.values()), ()))

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns, in the order of the file."""
        return tuple(self.cells)

    def column(self, *names: str) -> str:
        """Return the first of the names that is a column.

        Raises:
            UserError: None of the names is a column.
        """
        for name in names:
            if name in self.cells:
                return name
        columns = f"its columns are {', '.join(self.columns)}"
        if len(names) == 1:
            raise UserError(f"{self.path} has no column {names[0]}; {columns}.")
        raise UserError(
            f"{self.path} has no column that names the frames, such as {' or '.join(names[:3])}; "
            f"{columns}. Name it with --param column=COLUMN, or let `tactibench data import FOLDER "
            "NEW --guess` find it."
        )

    def numbers(self, column: str, *, allow_empty: bool = False) -> FloatArray:
        """Return the values of a column, (N,).

        Args:
            column: Name of the column.
            allow_empty: Whether a cell may be empty or blank, which gives NaN.

        Raises:
            UserError: A cell is no finite number; the sentence names its row.
        """
        numbers = self._parse(column)
        wrong = ~np.isfinite(numbers)
        if allow_empty:
            wrong &= [cell.strip() != "" for cell in self.cells[column]]
        bad = np.flatnonzero(wrong)
        if len(bad):
            cell = self.cells[column][bad[0]]
            raise UserError(
                f"{self.path} row {bad[0] + 1}: {column} is {cell!r}, but it must be a finite "
                f"number ({len(bad)} such row{'s' if len(bad) > 1 else ''}); {_advice(cell)}"
            )
        return numbers

    def numeric_share(self, column: str) -> float:
        """Return the share of a column's cells that are finite numbers."""
        return float(np.isfinite(self._parse(column)).mean())

    def _parse(self, column: str) -> FloatArray:
        """Return the values of a column, NaN where a cell is no number."""
        cells = self.cells[column]
        if self.comma:
            cells = [cell.replace(",", ".") for cell in cells]
        return np.array(
            [float(cell) if _NUMBER.fullmatch(cell) else math.nan for cell in cells],
            dtype=np.float64,
        )


def read_table(path: Path, data: bytes) -> Table:
    """Read the bytes of a CSV file, with or without a byte-order mark.

    Raises:
        UserError: The file is no table, has no rows, rows with more cells than the header, two
            columns of one name, or decimal commas beside decimal points.
    """
    try:
        text = data.decode("utf-8-sig")
        separator = max(_SEPARATORS, key=text.partition("\n")[0].count)
        rows = [
            row for row in csv.reader(io.StringIO(text, newline=""), delimiter=separator) if row
        ]
    except (UnicodeDecodeError, csv.Error) as error:
        raise UserError(f"{path} is not a readable CSV file: {error}.") from None
    if not rows:
        raise UserError(f"{path} is empty; it must have a header and one row a frame.")
    headed = not all(_NUMBER.fullmatch(cell) for cell in rows[0])
    if not headed:  # a first line of numbers alone is no header
        rows.insert(0, [f"column_{number}" for number in range(1, len(rows[0]) + 1)])
    header, *rows = rows
    if not rows:
        raise UserError(f"{path} has a header but no rows; it must list at least one frame.")
    names = [name.strip() or f"column {number}" for number, name in enumerate(header, start=1)]
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise UserError(f"{path} has two columns {twice[0]!r}; rename or remove one.")
    if any(len(row) > len(names) for row in rows):
        raise UserError(
            f"{path} has rows with more fields than its header; fix the file (numbers with "
            "decimal commas need columns separated by ';')."
        )
    cells = {
        name: [row[index] if index < len(row) else "" for row in rows]
        for index, name in enumerate(names)
    }
    comma = separator != "," and _has_decimal_commas(path, cells)
    return Table(path, cells, comma, headed)


def _has_decimal_commas(path: Path, cells: Mapping[str, Sequence[str]]) -> bool:
    comma, point = (_find_cell(cells, pattern) for pattern in (_COMMA_NUMBER, _POINT_NUMBER))
    if comma and point:
        raise UserError(
            f"{path} row {comma[0]} has the number {comma[1]!r} with a decimal comma, row "
            f"{point[0]} has {point[1]!r} with a point; write all numbers in one way."
        )
    return comma is not None


def _find_cell(
    cells: Mapping[str, Sequence[str]], pattern: re.Pattern[str]
) -> tuple[int, str] | None:
    """Return row and text of the first cell that the pattern fits."""
    matches = (
        (row, cell)
        for column in cells.values()
        for row, cell in enumerate(column, start=1)
        if pattern.fullmatch(cell)
    )
    return next(matches, None)


def _advice(cell: str) -> str:
    if _COMMA_NUMBER.fullmatch(cell):
        return (
            "the file uses decimal commas: write points, or separate the columns by ';' and write "
            "all numbers with commas."
        )
    return "fix or remove them."
