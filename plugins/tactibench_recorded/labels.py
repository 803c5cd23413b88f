"""targets.csv: names of the frames and the pose labels that this sensor uses."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
import numpy.typing as npt
import pandas as pd

from tactibench import UserError

NAME_COLUMNS = ("image_name", "sensor_image")
NUMBERED = tuple(f"pose_{axis}" for axis in "123456")
LETTERED = ("pose_x", "pose_y", "pose_z", "pose_Rx", "pose_Ry", "pose_Rz")
_ALIAS = dict(zip(NUMBERED + LETTERED, LETTERED + NUMBERED, strict=True))


@dataclass(frozen=True, eq=False)
class Labels:
    """names: of the frames, '/' as separator, in file order. depth: (N,) mm and tilt: (N,) deg as
    they stand in the file. columns: role -> column it was read from."""

    names: tuple[str, ...]
    depth: npt.NDArray[np.float64]
    tilt: npt.NDArray[np.float64]
    columns: dict[str, str]


def read_labels(path: Path, data: bytes, depth: str, tilt: str) -> Labels:
    """Read the bytes of a targets.csv; ``path`` is what error sentences call it.

    Rows are counted from 1 below the header. Raises UserError for a file that is no table, has no
    rows, lacks a column, names a frame twice or outside its folder, or holds a label that is not a
    finite number.
    """
    table = _read_table(path, data)
    columns = {
        "name": _column(path, table, NAME_COLUMNS),
        "depth": _column(path, table, (depth, _ALIAS[depth])),
        "tilt": _column(path, table, (tilt, _ALIAS[tilt])),
    }
    if not len(table):
        raise UserError(f"{path} has a header but no rows; it must list at least one frame.")
    poses = {
        name: _numbers(path, table, name) for name in NUMBERED + LETTERED if name in table.columns
    }
    _refuse_constant_depth(path, poses, columns["depth"])
    names = _names(path, table[columns["name"]].tolist())
    return Labels(names, poses[columns["depth"]], poses[columns["tilt"]], columns)


def _read_table(path: Path, data: bytes) -> pd.DataFrame:
    """Every cell as text, so that a bad one can be shown as it stands."""
    try:
        table = pd.read_csv(
            io.BytesIO(data), dtype=str, keep_default_na=False, encoding="utf-8-sig"
        )
    except pd.errors.EmptyDataError:
        raise UserError(f"{path} is empty; it must have a header and one row a frame.") from None
    except (pd.errors.ParserError, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise UserError(f"{path} is not a readable CSV file: {reason}.") from None
    if not isinstance(table.index, pd.RangeIndex):
        raise UserError(f"{path} has rows with more fields than its header; mend the file.")
    table.columns = table.columns.str.strip()
    return table.fillna("")  # a row with too few fields


def _column(path: Path, table: pd.DataFrame, names: tuple[str, ...]) -> str:
    for name in names:
        if name in table.columns:
            return name
    raise UserError(
        f"{path} has no column {' or '.join(names)}; its columns are {', '.join(table.columns)}."
    )


def _numbers(path: Path, table: pd.DataFrame, column: str) -> npt.NDArray[np.float64]:
    numbers: npt.NDArray[np.float64] = pd.to_numeric(table[column], errors="coerce").to_numpy(
        dtype=np.float64
    )
    bad = np.flatnonzero(~np.isfinite(numbers))
    if len(bad):
        cell = table[column].iloc[bad[0]]
        raise UserError(
            f"{path} row {bad[0] + 1}: {column} is {cell!r}, but a label must be a finite number "
            f"({len(bad)} such row{'s' if len(bad) > 1 else ''}); mend or remove them."
        )
    return numbers


def _refuse_constant_depth(
    path: Path, poses: dict[str, npt.NDArray[np.float64]], depth: str
) -> None:
    """A depth column that never changes beside one that does is the wrong column."""
    lengths = [name for name in (*NUMBERED[:3], *LETTERED[:3]) if name in poses]
    varying = [name for name in lengths if np.ptp(poses[name]) > 0]
    if varying and depth not in varying:
        raise UserError(
            f"{path}: the depth column {depth} has the same value in every row, while "
            f"{', '.join(varying)} changes; name the right one with --param sensor.depth=COLUMN."
        )


def _names(path: Path, cells: list[str]) -> tuple[str, ...]:
    seen: dict[str, int] = {}
    for row, cell in enumerate(cells, start=1):
        name = _inside(path, row, cell)
        if name in seen:
            raise UserError(
                f"{path} rows {seen[name]} and {row} both name the frame {name}; "
                "a frame may be listed once."
            )
        seen[name] = row
    return tuple(seen)


def _inside(path: Path, row: int, cell: str) -> str:
    """The name with '/' as separator, refused where it could lead out of the frames folder."""
    text = cell.strip().replace("\\", "/")
    if not text:
        raise UserError(f"{path} row {row} names no frame; every row needs a file name.")
    name = PurePosixPath(text)
    if name.is_absolute() or ".." in name.parts or ":" in text or "\0" in text:
        raise UserError(
            f"{path} row {row} names {cell!r}; a frame's name must be relative, stay inside the "
            "frames folder and hold no ':'."
        )
    return str(name)
