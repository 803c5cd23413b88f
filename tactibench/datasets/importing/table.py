"""Tables of labels: every cell as text, so that a bad one can be shown as it stands.

Cells are separated by commas, semicolons or tabs, whichever the header has most of. Decimal commas
are read where the columns are separated by something else and no cell has a decimal point.
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from tactibench.errors import UserError

FloatArray = npt.NDArray[np.float64]

_SEPARATORS = ",;\t"
_COMMA = re.compile(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*")
_POINT = re.compile(r"\s*[+-]?\d*\.\d+([eE][+-]?\d+)?\s*")


@dataclass(frozen=True, eq=False)
class Table:
    """path: what error sentences call it. cells: column -> texts, all of the same length.
    comma: whether numbers have decimal commas. Rows are counted from 1 below the header."""

    path: Path
    cells: Mapping[str, Sequence[str]]
    comma: bool = False

    def __len__(self) -> int:
        return len(next(iter(self.cells.values()), ()))

    @property
    def columns(self) -> tuple[str, ...]:
        return tuple(self.cells)

    def column(self, *names: str) -> str:
        """The first of the names that is a column. Raises UserError."""
        for name in names:
            if name in self.cells:
                return name
        raise UserError(
            f"{self.path} has no column {' or '.join(names)}; its columns are "
            f"{', '.join(self.columns)}."
        )

    def numbers(self, column: str) -> FloatArray:
        """(N,) the values of a column. Raises UserError with the row of one that is not finite."""
        numbers = self._read(column)
        bad = np.flatnonzero(~np.isfinite(numbers))
        if len(bad):
            cell = self.cells[column][bad[0]]
            raise UserError(
                f"{self.path} row {bad[0] + 1}: {column} is {cell!r}, but a label must be a finite "
                f"number ({len(bad)} such row{'s' if len(bad) > 1 else ''}); {_advice(cell)}"
            )
        return numbers

    def numeric(self, column: str) -> float:
        """Share of a column's cells that are finite numbers."""
        return float(np.isfinite(self._read(column)).mean())

    def _read(self, column: str) -> FloatArray:
        texts = pd.Series(list(self.cells[column]), dtype=str)
        if self.comma:
            texts = texts.str.replace(",", ".", regex=False)
        numbers = pd.to_numeric(texts, errors="coerce")
        return np.asarray(numbers, dtype=np.float64)


def read_table(path: Path, data: bytes) -> Table:
    """Read the bytes of a CSV file, a byte-order mark or not.

    Raises UserError for a file that is no table, has no rows, two columns of a name, or decimal
    commas beside decimal points.
    """
    try:
        text = data.decode("utf-8-sig")
        header = next(iter(text.splitlines()), "")
        separator = max(_SEPARATORS, key=header.count)
        _refuse_twins(path, next(csv.reader([header], delimiter=separator), []))
        table = pd.read_csv(io.StringIO(text), dtype=str, keep_default_na=False, sep=separator)
    except pd.errors.EmptyDataError:
        raise UserError(f"{path} is empty; it must have a header and one row a frame.") from None
    except (pd.errors.ParserError, UnicodeDecodeError, csv.Error) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise UserError(f"{path} is not a readable CSV file: {reason}.") from None
    if not isinstance(table.index, pd.RangeIndex):
        raise UserError(
            f"{path} has rows with more fields than its header; mend the file (numbers with "
            "decimal commas need columns separated by ';')."
        )
    if not len(table):
        raise UserError(f"{path} has a header but no rows; it must list at least one frame.")
    table.columns = table.columns.str.strip()
    table = table.fillna("")  # a row with too few fields
    cells = {str(name): table[name].tolist() for name in table.columns}
    comma = separator != "," and _has_decimal_commas(path, cells)
    return Table(path, cells, comma)


def _refuse_twins(path: Path, header: Sequence[str]) -> None:
    twice = [name for name, n in Counter(cell.strip() for cell in header).items() if n > 1 and name]
    if twice:
        raise UserError(f"{path} has two columns {twice[0]!r}; rename or remove one.")


def _has_decimal_commas(path: Path, cells: Mapping[str, Sequence[str]]) -> bool:
    commas, points = (_first(cells, pattern) for pattern in (_COMMA, _POINT))
    if commas and points:
        raise UserError(
            f"{path} row {commas[0]} has the number {commas[1]!r} with a decimal comma, row "
            f"{points[0]} has {points[1]!r} with a point; write all numbers in one way."
        )
    return commas is not None


def _first(cells: Mapping[str, Sequence[str]], pattern: re.Pattern[str]) -> tuple[int, str] | None:
    found = (
        (row, cell)
        for column in cells.values()
        for row, cell in enumerate(column, start=1)
        if pattern.fullmatch(cell)
    )
    return next(found, None)


def _advice(cell: str) -> str:
    if _COMMA.fullmatch(cell):
        return (
            "the file uses decimal commas: write points, or separate the columns by ';' and write "
            "all numbers with commas."
        )
    return "mend or remove them."
