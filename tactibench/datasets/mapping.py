"""A mapping file: the options of an import as TOML, guessed from a table, corrected by a person.

Columns are recognised by the words in their names, units and signs also by their values. Facts that
a table does not state, such as the place of 0, are guessed and marked in the file.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactibench.datasets.formats import frame_places
from tactibench.datasets.labels import is_number, named, texts
from tactibench.datasets.options import (
    DUAL,
    MM_PER,
    SINGLE,
    TIPS,
    ImportOptions,
    read_options,
    stated_unit,
)
from tactibench.datasets.tables import FloatArray, Table, read_table
from tactibench.datasets.vectors import read_label_table
from tactibench.errors import UserError
from tactibench.png import read_file
from tactibench.records import atomic

_WORDS = {
    "x": (r"x", r"[cp]x|pos(ition)?x|x(c|pos)"),
    "y": (r"y", r"[cp]y|pos(ition)?y|y(c|pos)"),
    "depth": (r".*depth.*", r"indent.*", r"penetr.*", r"z"),
    "spacing": (r"spacing", r"separation", r"dist(ance)?", r"gap"),
    "yaw": (r"yaw", r"rot(ation)?", r"orientation", r"angle", r"theta"),
    "press": (r"press(es)?", r"trial", r"touch", r"poke"),
}
"""Words by which a column is recognised, the surest first."""
_OTHER = {"pixel", "pixels", "force", "torque", "fx", "fy", "fz", "velocity", "target", "cmd"}
"""Words of columns that hold something else than the place of the tip."""
_PIXELS = {"px"}
"""Words that are a unit, unless the name begins with them: px, py are also places."""
_TURNS = {"deg", "rad", "degree", "degrees", "radian", "radians"}
_MAY_BE_NUMBER = {"spacing", "yaw"}
"""Roles for which one number may stand in place of a column."""
_FEWEST_PRESSES = 30
"""A column with fewer different names holds numbers of repeats, or sessions, and no presses."""
_FAR_MM = 20.0
"""No soft sensor is pressed so deep: such depths are heights of a robot."""


@dataclass(frozen=True)
class Guess:
    """Options for a folder, as they are written into a mapping file.

    Attributes:
        options: Option -> value as text.
        remarks: Option -> source of the value, or what a person should check.
    """

    options: Mapping[str, str]
    remarks: Mapping[str, str]

    def text(self) -> str:
        """Return the mapping file."""
        lines = [
            "# What the columns of this recording mean. Correct it, then import with --map FILE.",
            "# `tactibench data import --params` lists everything that can be said.",
        ]
        for name, value in self.options.items():
            remark = f"  # {self.remarks[name]}" if name in self.remarks else ""
            quoted = value.replace("\\", "\\\\").replace('"', '\\"')
            lines.append(f'{name} = "{quoted}"{remark}')
        return "\n".join(lines) + "\n"


def read_mapping(path: Path, params: Sequence[str] = ()) -> ImportOptions:
    """Return the options of a mapping file.

    Args:
        path: The file.
        params: Options as NAME=VALUE, which go before those of the file.

    Raises:
        UserError: The file cannot be read or is no TOML, an option does not exist, or its value is
            not allowed.
    """
    try:
        given = tomllib.loads(read_file(path).decode("utf-8"))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise UserError(f'{path} is no TOML file: {error}; write lines such as x = "cx".') from None
    first = {text.partition("=")[0] for text in params}
    mine = [
        f"{name}={','.join(map(str, value)) if isinstance(value, list) else value}"
        for name, value in given.items()
        if name not in first
    ]
    try:
        return read_options([*mine, *params])
    except UserError as error:
        raise UserError(f"{path}: {error}") from None


def write_mapping(path: Path, guess: Guess) -> None:
    """Write a mapping file where none exists.

    Raises:
        UserError: The file exists; a person may have corrected it.
    """
    if path.exists():
        raise UserError(f"{path} is there already; import with --map {path}, or remove it.")
    with atomic(path) as file:
        file.write(guess.text().encode())


def guess_mapping(folder: Path, params: Sequence[str] = ()) -> Guess:
    """Guess the options for a folder of frames with a table.

    Args:
        folder: Folder with a CSV file, and with the frames in it or in a folder below; or with the
            file of channels that ``params`` name.
        params: Options that are known, as NAME=VALUE; they are not guessed.

    Raises:
        UserError: No table names frames of the folder, or no column is a place or a depth.
    """
    if not folder.is_dir():
        raise UserError(f"{folder} is no folder; give the one that holds the table.")
    given = dict(text.partition("=")[::2] for text in params)
    known = read_options(params)  # an unknown option is named before anything is written
    remarks: dict[str, str] = {}
    if known.channels:
        table, column = read_label_table(folder, known)[0], ""
        options = {"table": table.path.name, "surface": "flat"}
        remarks["surface"] = "no table says it; remove the line if a dome is pressed"
    else:
        table, column, frames = _find_table(folder, given.get("table", ""))
        options = {"table": table.path.name, "column": column}
        if frames != folder:
            options["frames"] = frames.relative_to(folder).as_posix()
    numeric = [n for n in table.columns if n != column and _is_numeric(table, n)]
    columns = {role: _columns_of(role, numeric) for role in _WORDS if role != "press"}
    for role in columns.keys() & given:
        columns[role] = [
            name if role in _MAY_BE_NUMBER and is_number(name) else table.column(name)
            for name in named(given[role])
        ]
    missing = [role for role in ("x", "y", "depth") if not columns[role]]
    if missing:
        raise UserError(
            f"{table.path} has no column that looks like {' or '.join(missing)}; its columns are "
            f"{', '.join(table.columns)}. Say which it is with --param {missing[0]}=COLUMN; of a "
            "plate, `tactibench data fit` reads the tilt."
        )
    lists_tips = len(columns["x"]) == len(columns["y"]) == len(columns["depth"]) > 1
    options["indenter"] = TIPS if lists_tips else DUAL if columns["spacing"] else SINGLE
    for role in ("x", "y", "depth"):
        first, *others = columns[role]
        options[role] = ",".join(columns[role]) if lists_tips else first
        if others and not lists_tips:
            remarks[role] = f"or {', '.join(others)}?"
    if options["indenter"] == DUAL:
        options["spacing"] = columns["spacing"][0]
        if columns["yaw"]:
            options["yaw"] = columns["yaw"][0]
            remarks["yaw"] = "0: the pair lies along x"
        heights = [n for n in numeric if {"height", "h"} & {*_words(n)} and re.search(r"\d", n)]
        if len(heights) == 2:
            options["heights"] = ",".join(heights)
    press = _columns_of("press", [n for n in table.columns if n != column])
    if press and len(set(table.cells[press[0]])) >= _FEWEST_PRESSES:
        options["press"] = press[0]
        remarks["press"] = "frames of one press train or test, never both"
    options |= given  # before units and zeros are guessed: they depend on what is known
    _guess_units(options, remarks, table)
    _guess_zeros(options, remarks, table, is_signed="depth" in given)
    options.setdefault("radius_mm", "3.0")
    remarks["radius_mm"] = "of the tip; no table says it"
    return Guess(options, {k: v for k, v in remarks.items() if k not in given})


def _words(name: str) -> list[str]:
    """Return the words and numbers in a column's name: "contactX_1 [mm]" has contact, x, 1, mm."""
    parts = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return [word.lower() for word in re.findall(r"[A-Za-z]+|\d+", parts)]


def _is_numeric(table: Table, name: str) -> bool:
    """Return whether nearly all filled cells of a column are numbers.

    Empty cells do not count: a column of tips that seldom press is mostly empty.
    """
    cells = [cell for cell in map(str, table.cells[name]) if cell.strip()]
    return bool(cells) and table.numeric_share(name) * len(table) >= 0.9 * len(cells)


def _columns_of(role: str, names: Sequence[str]) -> list[str]:
    """Return the columns with the surest word of a role, in the order of their numbers."""
    for word in _WORDS[role]:
        columns = [n for n in names if any(re.fullmatch(word, w) for w in _words(n))]
        columns = [n for n in columns if not (_OTHER | _PIXELS & {*_words(n)[1:]}) & {*_words(n)}]
        if columns:
            return sorted(columns, key=lambda n: ([int(w) for w in _words(n) if w.isdigit()]))
    return []


def _guess_units(options: dict[str, str], remarks: dict[str, str], table: Table) -> None:
    """Guess units from names, or from values that are too small for mm or degrees."""
    places = named(options["x"]) + named(options["y"])
    units = {unit for name in places if (unit := stated_unit(name)) in MM_PER}
    if units:
        options.setdefault("unit", str(sorted(units)[0]))
    elif "unit" not in options:
        largest = float(np.nanmax(np.abs(_values(table, places))))
        if largest < 0.1:  # 100 um across: no sensor of this kind is so small
            options["unit"] = "m"
            remarks["unit"] = f"places reach only {largest:g}"
        else:
            remarks["x"] = "; ".join(filter(None, [remarks.get("x", ""), "taken as mm"]))
    if "yaw" in options and "angles" not in options and not is_number(options["yaw"]):
        words = set(_words(options["yaw"]))
        largest = float(np.nanmax(np.abs(_values(table, texts(options["yaw"])))))
        if words & {"rad", "radian", "radians"} or (not words & _TURNS and largest <= 6.3):
            options["angles"] = "rad"
            remarks["angles"] = f"turns reach {largest:.3g}"


def _guess_zeros(
    options: dict[str, str], remarks: dict[str, str], table: Table, *, is_signed: bool
) -> None:
    """Guess the zeros of places that never reach 0, and the sign and the zero of depths.

    Args:
        options: Option -> value; zeros that are there stay.
        remarks: Option -> source of the value.
        table: The labels.
        is_signed: Whether the sign of the depth is known.
    """
    factor = MM_PER[options.get("unit", "mm")]
    for axis in "xy":  # a zero is that of the column as it stands, also where it is negated
        values = factor * _values(table, named(options[axis]))
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        if (low > 0 or high < 0) and f"{axis}_zero_mm" not in options:
            middle = (low + high) / 2
            options[f"{axis}_zero_mm"] = f"{middle:.6g}"
            remarks[f"{axis}_zero_mm"] = f"the middle of {low:.4g} to {high:.4g} mm: check it"
    names = texts(options["depth"])
    values = factor * _values(table, names)
    if not is_signed and float(np.nanmedian(values)) < 0:
        options["depth"] = ",".join(f"-{name}" for name in names)
        remarks["depth"] = "negative values are taken as deeper"
        values = -values
    low = float(np.nanmin(values))
    if (low > _FAR_MM or low < 0) and "offset_mm" not in options:
        options["offset_mm"] = f"{-low:.6g}"
        remarks["offset_mm"] = "the shallowest is taken as first touch: check it"


def _values(table: Table, columns: Iterable[str]) -> FloatArray:
    """Return the values of all columns, negated where a name begins with '-'."""
    return np.concatenate(
        [
            (-1.0 if name.startswith("-") else 1.0)
            * table.numbers(name.removeprefix("-"), allow_empty=True)
            for name in columns
        ]
    )


def _find_table(folder: Path, name: str) -> tuple[Table, str, Path]:
    """Return the table that names most frames, its column of names, and the frames' folder."""
    paths = [folder / name] if name else sorted(folder.glob("*.csv"))
    places = frame_places(folder)
    best: tuple[int, Table, str, Path] | None = None
    for path in paths:
        if not path.is_file():
            raise UserError(f"{folder} holds no {path.name}; name another table.")
        table = read_table(path, read_file(path))
        for column in table.columns:
            cells = [cell.strip().replace("\\", "/") for cell in table.cells[column][:20]]
            for place in places:
                count = sum(bool(cell) and (place / cell).is_file() for cell in cells)
                if count and (best is None or count > best[0]):
                    best = (count, table, column, place)
    if best is None:
        tables = ", ".join(path.name for path in paths) or "no CSV file"
        raise UserError(
            f"{folder} holds {tables}, and no column of a table names files of the folder; write "
            "the names of the frames, with .png, into one. Of a sensor without a camera, name the "
            "table of its numbers with --param channels=FILE."
        )
    return best[1:]
