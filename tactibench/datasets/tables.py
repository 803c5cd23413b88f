"""Tables of labels: every cell as text, so that an error can show it as it stands.

Cells are separated by commas, semicolons or tabs, whichever the header has most of. Decimal commas
are read where the columns are separated by something else and no cell has a decimal point.
"""

from __future__ import annotations

import io
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from tactibench.errors import UserError

FloatArray = npt.NDArray[np.float64]

_SEPARATORS = ",;\t"
_COMMAS = " (decimal commas need columns separated by ';', and no points)."
_NUMBER = r"[ \t\xa0]*[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?[ \t\xa0]*"
_COMMA_NUMBER = r"[ \t\xa0]*[+-]?[0-9]*,[0-9]+([eE][+-]?[0-9]+)?[ \t\xa0]*"
_POINT_NUMBER = r"[ \t\xa0]*[+-]?[0-9]*\.[0-9]+([eE][+-]?[0-9]+)?[ \t\xa0]*"


@dataclass(frozen=True, eq=False)
class Table:
    """A table of texts. Rows are counted from 1 below the header.

    Attributes:
        path: The file, for errors.
        cells: The texts, a column each.
        comma: Whether numbers have decimal commas.
        header: Whether the names of the columns stand in the file; else they are column_1 ....
    """

    path: Path
    cells: pd.DataFrame
    comma: bool = False
    header: bool = True

    def __len__(self) -> int:
        return len(self.cells)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns, in the order of the file."""
        return tuple(self.cells.columns)

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
        numbers, cells = self._parse(column), self.cells[column]
        wrong = ~np.isfinite(numbers)
        if allow_empty:
            wrong &= cells.str.strip() != ""
        bad = np.flatnonzero(wrong)
        if len(bad):
            raise UserError(
                f"{self.path} row {bad[0] + 1}: {column} is {cells.iloc[bad[0]]!r}, but it must be "
                f"a finite number ({len(bad)} such row{'s' if len(bad) > 1 else ''}); fix or "
                f"remove them{_COMMAS if ',' in cells.iloc[bad[0]] else '.'}"
            )
        return numbers

    def numeric_share(self, column: str) -> float:
        """Return the share of a column's cells that are finite numbers."""
        return float(np.isfinite(self._parse(column)).mean())

    def _parse(self, column: str) -> FloatArray:
        """Return the values of a column, NaN where a cell is no number."""
        cells = self.cells[column].astype(object)
        if self.comma:
            cells = cells.str.replace(",", ".")
        # Python's float() rounds correctly, pandas' own parser of numbers does not.
        numbers = cells.where(cells.str.fullmatch(_NUMBER)).astype(float)
        return np.asarray(numbers.to_numpy(), dtype=np.float64)


def read_table(path: Path, data: bytes) -> Table:
    """Read the bytes of a CSV file, with or without a byte-order mark.

    Raises:
        UserError: The file is no table, has no rows, rows with more cells than the header, two
            columns of one name, or decimal commas beside decimal points.
    """
    try:
        text = data.decode("utf-8-sig")
        separator = max(_SEPARATORS, key=text.partition("\n")[0].count)
        rows = pd.read_csv(
            io.StringIO(text), sep=separator, header=None, dtype=str, keep_default_na=False
        ).fillna("")
    except pd.errors.EmptyDataError:
        raise UserError(f"{path} is empty; it must have a header and one row a frame.") from None
    except (UnicodeDecodeError, pd.errors.ParserError) as error:
        raise UserError(
            f"{path} is not a readable CSV file: {str(error).strip()}; fix the file{_COMMAS}"
        ) from None
    names = [name.strip() or f"column {number}" for number, name in enumerate(rows.iloc[0], 1)]
    headed = not rows.iloc[0].str.fullmatch(_NUMBER).all()
    if headed:
        rows = rows.iloc[1:].reset_index(drop=True)
    else:  # a first line of numbers alone is no header
        names = [f"column_{number}" for number in range(1, len(names) + 1)]
    if not len(rows):
        raise UserError(f"{path} has a header but no rows; it must list at least one frame.")
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise UserError(f"{path} has two columns {twice[0]!r}; rename or remove one.")
    cells = rows.set_axis(names, axis=1)
    return Table(path, cells, separator != "," and _has_decimal_commas(path, cells), headed)


def _has_decimal_commas(path: Path, cells: pd.DataFrame) -> bool:
    texts = cells.stack()
    comma, point = (texts[texts.str.fullmatch(kind)] for kind in (_COMMA_NUMBER, _POINT_NUMBER))
    if len(comma) and len(point):
        raise UserError(
            f"{path} row {comma.index[0][0] + 1} has the number {comma.iloc[0]!r} with a decimal "
            f"comma, row {point.index[0][0] + 1} has {point.iloc[0]!r} with a point; write all "
            "numbers in one way."
        )
    return len(comma) > 0
