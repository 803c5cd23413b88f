"""Tables: the columns of a file, whatever its format.

Text tables keep every cell as text, so that an error can show it as it stands. Arrays of numbers
(.mat, .h5, .npz, .npy) and Parquet files are columns of numbers; an array of several values a row
has a column for each of them, NAME_1, NAME_2, ....
"""

from __future__ import annotations

import csv
import fnmatch
import io
import re
import struct
import zipfile
import zlib
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from tactibench.datasets.labels import unit_word
from tactibench.datasets.pictures import PICTURES
from tactibench.errors import UserError, did_you_mean

FloatArray = npt.NDArray[np.float64]

TEXT_SUFFIXES = (".csv", ".txt", ".tsv", ".dat")
SUFFIXES = (*TEXT_SUFFIXES, ".mat", ".h5", ".hdf5", ".npz", ".npy", ".parquet")
"""Files that are tables."""
_SEPARATORS = "\t;, "
"""Separators of columns; of two that fit equally well the first one is taken."""
_SAMPLE = 50
"""Lines from which the separator is told: more than any header has."""
_COMMAS = " (decimal commas need columns separated by ';'; thousands have no separators)."
_THOUSANDS = r"[+-]?[1-9][0-9]{0,2}([.,' ][0-9]{3})+([.,][0-9]+)?"
_NUMBER = r"[ \t\xa0]*[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?[ \t\xa0]*"
_COMMA_NUMBER = r"[ \t\xa0]*[+-]?[0-9]*,[0-9]+([eE][+-]?[0-9]+)?[ \t\xa0]*"
_POINT_NUMBER = r"[ \t\xa0]*[+-]?[0-9]*\.[0-9]+([eE][+-]?[0-9]+)?[ \t\xa0]*"
_NO_VALUE = re.compile(r"\s*(nan|n/?a|null|none|-+)?\s*", re.IGNORECASE)
_ANY_NUMBER = re.compile(rf"{_NUMBER}|{_COMMA_NUMBER}|{_THOUSANDS}|\s*[+-]?(?i:nan|inf)\s*")
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f]")
_GROUPED, _FEWEST_GROUPED = r"\s*[+-]?[1-9][0-9]{0,2}\.[0-9]{3}\s*", 5
"""Numbers that may be thousands where all others are whole and below 1000, and how many tell it."""
_MOST_LABELS = 64
"""Values of an array that are labels of one press: more are a signal."""
_MOST_SHOWN = 24
"""Columns that an error names: as many as fit into a few lines."""
_UNREADABLE = (
    *(ValueError, TypeError, LookupError, AttributeError, ArithmeticError, OSError, EOFError),
    *(MemoryError, RuntimeError, zlib.error, zipfile.BadZipFile, struct.error),
)
"""Exceptions with which libraries refuse damaged files."""


@dataclass(frozen=True, eq=False)
class Table:
    """A table. Rows are counted from 1 below the header.

    Attributes:
        path: The file, for errors.
        cells: The cells, a column each: texts, or numbers where the file holds numbers.
        comma: Whether numbers have decimal commas.
        header: Whether the names of the columns stand in the file; else they are column_1 ....
        arrays: Array of several values a row -> their shape.
        notes: Sentences about parts of the file that were left out.
    """

    path: Path
    cells: pd.DataFrame
    comma: bool = False
    header: bool = True
    arrays: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    _parsed: dict[str, FloatArray] = field(default_factory=dict, init=False, repr=False)

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
        what, how = f"column {names[0]!r}", did_you_mean(names[0], self.columns)
        if len(names) > 1:
            what = f"column that names the frames, such as {' or '.join(names[:3])}"
            guess = "add --param column=COLUMN, or try `tactibench data import --guess`"
            how = f"its columns are {shown(self.columns)}; {guess}."
        raise UserError(f"{self.path} has no {what}; {how}")

    def select(self, text: str) -> tuple[str, ...]:
        """Return the columns of a list with commas: names, arrays, FIRST:LAST, or patterns with *.

        Raises:
            UserError: A name is neither a column nor an array, or nothing fits a pattern.
        """
        chosen: dict[str, None] = {}
        for name in filter(None, map(str.strip, text.split(","))):
            first, _, last = name.partition(":")
            if name in self.cells:
                names = [name]
            elif name in self.arrays:
                names = list(_array_columns(name, self.arrays[name]))
            elif first in self.cells and last in self.cells:
                at = self.columns.index
                names = list(self.columns[at(first) : at(last) + 1])
            else:
                names = fnmatch.filter(self.columns, name) if "*" in name else []
            chosen |= dict.fromkeys(names or [self.column(name)])
        return tuple(chosen)

    def listed(self, columns: Sequence[str]) -> str:
        """Return the text for which ``select`` gives these columns."""
        text = f"{columns[0]}:{columns[-1]}"
        return text if list(self.select(text)) == [*columns] else ",".join(columns)

    @property
    def signals(self) -> set[str]:
        """Columns of arrays with so many values a row that they are signals, and no labels."""
        large = {name: shape for name, shape in self.arrays.items() if prod(shape) > _MOST_LABELS}
        return {column for name in large for column in _array_columns(name, large[name])}

    def shape(self, columns: Sequence[str]) -> tuple[int, ...]:
        """Return the shape of a row of these columns: that of the array that they are, or (C,)."""
        for name, shape in self.arrays.items():
            if tuple(columns) == _array_columns(name, shape):
                return shape
        return (len(columns),)

    def numbers(self, column: str, *, allow_empty: bool = False) -> FloatArray:
        """Return the values of a column, (N,).

        Args:
            column: Name of the column.
            allow_empty: Whether a cell may be empty, blank or NaN, which gives NaN.

        Raises:
            UserError: A cell is no finite number; the sentence names its row.
        """
        numbers = self._parse(column)
        bad = np.flatnonzero(~np.isfinite(numbers)).tolist()
        cells = {row: str(self.cells[column].iloc[row]) for row in bad}
        if allow_empty:
            bad = [row for row in bad if not _NO_VALUE.fullmatch(cells[row])]
        if bad:
            raise UserError(
                f"{self.path} row {bad[0] + 1}: {column} is {cells[bad[0]]!r}, but it must be "
                f"a finite number ({len(bad)} such row{'s' if len(bad) > 1 else ''}); fix or "
                f"remove them{_COMMAS if re.search('[,.]', cells[bad[0]]) else '.'}"
            )
        return numbers

    def blank(self, columns: Collection[str]) -> npt.NDArray[np.bool_]:
        """Return the rows, (N,), that have no value in any of these columns: nothing is touched."""
        cells = self.cells[[*columns]].map(lambda cell: bool(_NO_VALUE.fullmatch(str(cell))))
        return np.asarray(cells.all(axis=1) & bool(columns), dtype=bool)

    def numeric_share(self, column: str) -> float:
        """Return the share of a column's cells that are finite numbers."""
        return float(np.isfinite(self._parse(column)).mean())

    def _parse(self, column: str) -> FloatArray:
        """Return the values of a column, NaN where a cell is no number; every column once."""
        if column not in self._parsed:
            self._parsed[column] = self._values(self.cells[column])
        return self._parsed[column].copy()

    def _values(self, cells: pd.Series[Any]) -> FloatArray:
        if cells.dtype.kind in "biuf":
            return cells.to_numpy(dtype=np.float64)
        cells = cells.astype(object)
        if self.comma:
            cells = cells.str.replace(",", ".")
        # Python's float() rounds correctly, pandas' own parser of numbers does not.
        try:
            numbers = np.array([float(cell) for cell in cells])
            if not any("_" in cell for cell in cells):  # float() takes 1_0 for ten
                whole = numbers % 1 == 0
                if whole.any() and not whole.all() and (np.abs(numbers) < 1000).all():
                    grouped = cells[~whole].str.fullmatch(_GROUPED)
                    if len(grouped) >= _FEWEST_GROUPED and grouped.all():
                        numbers[~whole] = np.nan  # 1.234 beside 56: maybe a thousand and more
                return numbers
        except ValueError:
            pass
        is_number = cells.str.fullmatch(_NUMBER)
        return np.asarray(cells.where(is_number).astype(float).to_numpy(), dtype=np.float64)


def shown(columns: Sequence[str], most: int = _MOST_SHOWN) -> str:
    """Return names of columns for a sentence; the middle of more than ``most`` is left out."""
    if len(columns) > most:
        half = most // 2
        left_out = f"... ({len(columns) - 2 * half:,} more)"
        columns = [*columns[:half], left_out, *columns[-half:]]
    return ", ".join(columns)


def rank_correlation(first: FloatArray, second: FloatArray, fewest: int = 3) -> float:
    """Return the rank correlation of rows with both values, 0 of few rows or a constant value."""
    both = pd.DataFrame({"first": first, "second": second}).dropna()
    if len(both) < fewest or (both.max() == both.min()).any():
        return 0.0
    return float(np.corrcoef(both.rank().to_numpy().T)[0, 1])  # scipy.stats takes seconds to import


def rank_of_alike(
    channels: FloatArray, label: FloatArray, presses: npt.NDArray[Any] | None = None
) -> float | None:
    """Return the rank correlation of a label with that of the row whose channels are most alike.

    Args:
        channels: (N, C) channels of every row.
        label: (N,) values.
        presses: (N,) names of presses, which are not compared with themselves; None: rows are.

    Returns:
        The correlation; None where there is one press.
    """
    from scipy.spatial import cKDTree

    presses = np.arange(len(label)) if presses is None else presses
    most = int(np.unique(presses, return_counts=True)[1].max())
    if most == len(presses):
        return None
    near = cKDTree(channels).query(channels, k=most + 1)[1]  # one of them is of another press
    other = near[np.arange(len(near)), (presses[near] != presses[:, None]).argmax(axis=1)]
    return rank_correlation(label, label[other])


def spread_evenly(count: int, most: int) -> npt.NDArray[np.intp]:
    """Return at most so many numbers below ``count``, evenly spread from the first to the last."""
    return np.linspace(0, count - 1, min(most, count)).round().astype(np.intp)


def is_table(path: Path) -> bool:
    """Return whether a file is a table by its name; hidden files and lists of packages are none."""
    hidden = path.name.startswith((".", "~$")) or path.stem.lower() in {"readme", "requirements"}
    return path.suffix.lower() in SUFFIXES and not hidden and path.is_file()


def read_table(path: Path, data: bytes) -> Table:
    """Read the bytes of a table; the name of its file tells the format.

    Raises:
        UserError: The file is no such table, has no rows, rows that are longer or shorter than the
            others, two columns of one name, or decimal commas beside decimal points; or a library
            that reads it is not installed.
    """
    kind = path.suffix.lower()
    if kind not in SUFFIXES or kind in TEXT_SUFFIXES:
        return _read_text(path, data)
    try:
        if kind == ".parquet":
            frame = pd.read_parquet(io.BytesIO(data))
            arrays = {str(name): np.asarray(column) for name, column in frame.items()}
        elif kind in (".npz", ".npy"):
            loaded = np.load(io.BytesIO(data), allow_pickle=False)
            arrays = {"column": loaded} if isinstance(loaded, np.ndarray) else dict(loaded)
        elif kind == ".mat" and data[:10] != b"MATLAB 7.3":
            arrays = _read_matlab(data)
        else:
            arrays = _read_hdf5(data)
    except ImportError as error:
        raise UserError(
            f'{path} needs {error.name or "pyarrow"}; install it: pip install "tactibench[files]".'
        ) from None
    except _UNREADABLE as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise UserError(f"{path} holds no arrays of numbers: {reason}.") from None
    return _table_of_arrays(path, _join_groups(dict(_flatten(arrays))))


def _read_matlab(data: bytes) -> dict[str, Any]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        content: dict[str, Any] = loadmat(io.BytesIO(data), simplify_cells=True)
    except MatReadError as error:
        raise ValueError(error) from None
    return {name: value for name, value in content.items() if not str(name).startswith("__")}


def _read_hdf5(data: bytes) -> dict[str, Any]:
    """Return the arrays of an HDF5 file; MATLAB writes their dimensions in reverse order."""
    import h5py

    arrays: dict[str, Any] = {}
    with h5py.File(io.BytesIO(data)) as file:

        def keep(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and not name.startswith("#") and item.shape:
                value = item.asstr()[()] if h5py.check_string_dtype(item.dtype) else item[()]
                arrays[name] = value.T if "MATLAB_class" in item.attrs else value

        file.visititems(keep)
    return arrays


def _flatten(values: Any, prefix: str = "") -> Iterator[tuple[str, npt.NDArray[Any]]]:
    """Yield the arrays of nested structures by their names, such as trial.force."""
    if isinstance(values, list | np.ndarray) and len(values) and isinstance(values[0], dict):
        # A list of structures, one a row, is a structure of columns.
        values = {key: [value.get(key) for value in values] for key in values[0]}
    if isinstance(values, dict):
        for name, value in values.items():
            yield from _flatten(value, f"{prefix}.{name}" if prefix else str(name))
    elif isinstance(values, np.ndarray) and values.dtype.names:
        yield from _flatten({name: values[name] for name in values.dtype.names}, prefix)
    else:
        try:
            array = np.asarray(values)
        except ValueError:  # rows of different lengths
            return
        if array.dtype.kind == "O" and array.ndim:
            try:
                array = np.array(array.tolist())
            except ValueError:
                return
        if array.dtype.kind in "biufUS" and array.ndim:
            yield prefix, array


def _join_groups(arrays: dict[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
    """Return arrays of numbered groups, trial_0/x, trial_1/x, ..., one behind the other.

    What is not of the length of its group, such as the place of a trial, holds for all its rows.
    """
    groups: dict[str, dict[str, npt.NDArray[Any]]] = {}
    for name, array in arrays.items():
        group, member = re.findall(r"^(.*?\d+)[/.](.+)|$", name)[0]
        groups.setdefault(group, {})[member] = array
    keys = [group.keys() for group in groups.values()]
    if len(keys) < 2 or "" in groups or any(each != keys[0] for each in keys):
        return arrays
    counts = [Counter(map(len, group.values())).most_common(1)[0][0] for group in groups.values()]
    parts = [
        {m: a if len(a) == count else np.repeat(a[None], count, axis=0) for m, a in group.items()}
        for group, count in zip(groups.values(), counts, strict=True)
    ]
    joined = {member: np.concatenate([part[member] for part in parts]) for member in keys[0]}
    return joined | {"group": np.repeat([*groups], counts)}


def _table_of_arrays(path: Path, arrays: Mapping[str, npt.NDArray[Any]]) -> Table:
    """Return the arrays as columns: rows are the length that most of them have."""
    lengths = Counter(n for array in arrays.values() for n in {*array.shape} if n)
    if not lengths:
        raise UserError(f"{path} holds no arrays of numbers.")
    rows = max(lengths, key=lambda length: (lengths[length], length))
    blocks, shapes, left_out = [], {}, []
    for name, array in arrays.items():
        if rows not in array.shape or (array.dtype.kind in "US" and array.ndim > 1):
            left_out.append(f"{name} {array.shape}")
            continue
        array = np.moveaxis(array, array.shape.index(rows), 0)
        array = array if array.dtype.kind in "US" else array.astype(np.float64)
        shape = array.shape[1:]
        if prod(shape) > 1 or name == "column":
            shapes[name] = shape or (1,)
        names = _array_columns(name, shapes[name]) if name in shapes else [name]
        blocks.append(pd.DataFrame(array.reshape(rows, -1), columns=names))
    cells = pd.concat(blocks, axis=1)
    _refuse_twice(path, list(cells.columns))
    note = f"{path.name}: left out, not of {rows:,} rows: {shown(left_out)}."
    notes = (note,) if left_out else ()
    return Table(path, cells, header="column" not in shapes, arrays=shapes, notes=notes)


def _array_columns(name: str, shape: tuple[int, ...]) -> tuple[str, ...]:
    return tuple(f"{name}_{number}" for number in range(1, prod(shape) + 1))


def _read_text(path: Path, data: bytes) -> Table:
    lines, separator, notes = _lines(path, data)
    try:
        rows = [row for row in _split(lines, separator) if any(map(str.strip, row))]
    except csv.Error as error:
        raise UserError(f"{path} is not a readable CSV file: {error}; fix the file.") from None
    rows = _equally_long(path, rows)
    names, units, headed = _header(rows)
    body = rows[headed + bool(units) :]
    if not body:
        raise UserError(f"{path} has a header but no rows; it must list at least one frame.")
    # A comma divides names of columns in options.
    names = [n.replace(",", ";") for n in names]
    names = [f"{n} [{units[at]}]" if units.get(at) else n for at, n in enumerate(names)]
    _refuse_cut_off(path, data, body)
    for at in [at for at, cell in enumerate(body[0]) if cell.strip().lower().endswith(PICTURES)]:
        starts = [re.sub(r"\d+\D*$", "", row[at].strip()) for row in body]
        if 1 < len(set(starts)) < len(body) and all(starts):  # press7/3.png, press7_3.png
            names.append(f"{names[at]} start")
            body = [[*row, start] for row, start in zip(body, starts, strict=True)]
    _refuse_twice(path, names)
    cells = pd.DataFrame(body, columns=names, dtype=object)
    comma = separator != "," and _has_decimal_commas(path, cells)
    return Table(path, cells, comma, bool(headed), notes=notes)


def _lines(path: Path, data: bytes) -> tuple[list[str], str, tuple[str, ...]]:
    """Return the lines of a text with their separator, and notes on lines that were left out.

    A line ``sep=;`` and comments above the header are left out; a comment that has as many cells as
    the rows below it is the header.
    """
    lines = [line for line in _decode(path, data).splitlines(keepends=True) if line.strip()]
    if lines and (told := re.fullmatch(r"sep=(.)\s*", lines[0], re.IGNORECASE)):
        return lines[1:], told[1], ()
    start = next((n for n, line in enumerate(lines) if line[0] not in "#%"), len(lines))
    comments, lines = [line.lstrip("#% \t") for line in lines[:start]], lines[start:]
    if not lines:
        raise UserError(f"{path} is empty; it must have a header and one row a frame.")
    separator = max(_SEPARATORS, key=lambda each: _fit(lines[:_SAMPLE], each))
    widths = [len(row) for row in _split(lines[:_SAMPLE], separator)]
    usual = max(widths, key=widths.count)
    skipped = next((n for n, width in enumerate(widths) if width > 1 or usual == 1), 0)
    if comments and len(_split(comments[-1:], separator)[0]) == usual:
        lines.insert(0, comments.pop())
    elif skipped:
        comments += lines[:skipped]
        lines = lines[skipped:]
    what = f"{len(comments)} line{'s' if len(comments) > 1 else ''} above the table"
    return lines, separator, (f"{path.name}: left out, {what}.",) * bool(comments)


def _decode(path: Path, data: bytes) -> str:
    """Return the text of a file in UTF-8, UTF-16 or Windows' western code page."""
    try:
        if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
            return data.decode("utf-16")
        if b"\0" in data[:100]:
            return data.decode("utf-16-be" if data[:1] == b"\0" else "utf-16-le")
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("cp1252")
    except UnicodeDecodeError as error:
        raise UserError(f"{path} is not a readable CSV file: {error}; fix the file.") from None
    if wrong := _CONTROL.search(text):
        raise UserError(
            f"{path} is not a readable CSV file: it holds the character {wrong[0]!r}; fix the file."
        )
    return text


def _split(lines: Sequence[str], separator: str) -> list[list[str]]:
    if separator == " ":  # any number of spaces and tabs
        lines = [" ".join(line.split()) for line in lines]
    return list(csv.reader(lines, delimiter=separator, skipinitialspace=separator == " "))


def _fit(lines: Sequence[str], separator: str) -> float:
    """Return how well a separator divides lines: into equal rows, and into cells with numbers."""
    try:
        rows = [row for row in _split(lines, separator) if row]
    except csv.Error:
        return 0.0
    widths = [len(row) for row in rows]
    cells = [cell for row in rows for cell in row]
    usual = max(widths, key=widths.count)
    numbers = sum(_ANY_NUMBER.fullmatch(cell) is not None for cell in cells)
    return widths.count(usual) / len(rows) + numbers / len(cells) if usual > 1 else 0.0


def _equally_long(path: Path, rows: list[list[str]]) -> list[list[str]]:
    """Return rows of one length; empty cells at the ends of all rows are no column.

    Raises:
        UserError: A row has more or fewer cells than the first one.
    """
    width = len(rows[0])
    if len(rows) > 1 and all(len(row) == width + 1 and not row[-1].strip() for row in rows[1:]):
        rows = [rows[0], *(row[:-1] for row in rows[1:])]  # a separator behind every row
    for number, row in enumerate(rows[1:], start=2):
        if len(row) != width:
            what = "was cut off there" if number == len(rows) and len(row) < width else "is damaged"
            raise UserError(
                f"{path} is not a readable CSV file: it {what}: Expected {width} fields in line "
                f"{number}, saw {len(row)}; fix the file{_COMMAS}"
            )
    while width > 1 and not any(row[width - 1].strip() for row in rows):
        width -= 1
    return [row[:width] for row in rows]


def _refuse_cut_off(path: Path, data: bytes, body: Sequence[Sequence[str]]) -> None:
    """Refuse a last line without an end whose last number has fewer decimals than all others."""
    *others, last = (len(re.split("[.,]", row[-1].strip(), maxsplit=1)[-1]) for row in body)
    decimal = all(re.search("[.,]", row[-1]) for row in body[:-1])
    cut = len(others) >= _SAMPLE and decimal and {*others} == {max(others)} and last < others[0]
    if cut and not data.endswith((b"\n", b"\r", b"\n\0", b"\0\n")):
        raise UserError(
            f"{path}: the last line has no end, and its number {body[-1][-1].strip()!r} fewer than "
            f"{others[0]} decimals: it was cut off; complete or remove it."
        )


def _header(rows: Sequence[Sequence[str]]) -> tuple[list[str], dict[int, str], int]:
    """Return names of the columns, their units below the names, and the number of header lines.

    A first line is a header where a column of numbers begins with a text.
    """

    def are_numbers(row: Sequence[str]) -> list[bool]:
        return [_ANY_NUMBER.fullmatch(cell) is not None for cell in row]

    first, below = rows[0], [are_numbers(row) for row in rows[1 : 1 + _SAMPLE]]
    second = [cell.strip(" []()<>{}") for cell in rows[1]] if len(rows) > 2 else []
    units = {at: unit for at, cell in enumerate(second) if (unit := unit_word(cell))}
    if not all(at in units or not re.search(r"\w", cell) for at, cell in enumerate(second)):
        units = {}
    numeric = np.flatnonzero(np.any(below[bool(units) :], axis=0)).tolist() if below else []
    plain = are_numbers(first)
    begins = [plain[at] or not first[at].strip() for at in numeric]
    if not units and (all(plain) or (numeric and all(begins))):
        return [f"column_{number}" for number in range(1, len(first) + 1)], {}, 0
    return [name.strip() or f"column {number}" for number, name in enumerate(first, 1)], units, 1


def _refuse_twice(path: Path, names: Sequence[str]) -> None:
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise UserError(f"{path} has two columns {twice[0]!r}; rename or remove one.")


def _has_decimal_commas(path: Path, cells: pd.DataFrame) -> bool:
    if not cells.map(lambda cell: "," in cell).to_numpy().any():
        return False
    texts = cells.stack()
    comma, point = (texts[texts.str.fullmatch(kind)] for kind in (_COMMA_NUMBER, _POINT_NUMBER))
    if len(comma) and len(point):
        raise UserError(
            f"{path} row {comma.index[0][0] + 1} has the number {comma.iloc[0]!r} with a decimal "
            f"comma, row {point.index[0][0] + 1} has {point.iloc[0]!r} with a point; write all "
            "numbers in one way."
        )
    return len(comma) > 0
