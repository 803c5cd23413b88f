"""A mapping file: the options of an import as TOML, guessed from a folder, corrected by a person.

Files tell which of them holds what; evidence tells what their columns mean (``roles``). What is not
known is asked for, or left out and named with the line to write.
"""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from itertools import groupby
from math import prod
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactibench.datasets.formats import (
    find_frame,
    find_tables,
    find_video,
    frame_name,
    frame_places,
    inside,
    video_names,
)
from tactibench.datasets.labels import FRAME_FOLDERS, ImportOptions, given_columns, read_options
from tactibench.datasets.pictures import check_picture, is_picture, read_picture, video_frames
from tactibench.datasets.roles import (
    Evidence,
    counts_up,
    find_press,
    find_roles,
    is_numeric,
    stem,
    take_apart,
    words,
)
from tactibench.datasets.tables import FloatArray, Table, read_table, shown
from tactibench.errors import UserError, read_file
from tactibench.records import atomic

_MOST_LABELS = 8
"""Columns that the labels of a press have at most: more are channels."""
_GRID = 0.2
"""Most different values of a column of places on a grid, as a share of its rows."""
_PROBED, _MOST_ROWS = 100, 1500
"""Frames that are read, and rows of channels that are compared, to learn whether the signal follows
a column."""
_UNREAD = (".xlsx", ".xls", ".ods", ".json", ".yaml", ".xml", ".bag", ".pkl", ".pickle")
"""Files in which labs keep labels, too."""
_NAMED = 20
"""Rows whose frames are looked for, to learn which column names them."""
_LEAST_SERIES = 3
"""Columns with names in a series that are channels: fewer may be labels."""


@dataclass(frozen=True)
class Guess:
    """Options for a folder, as they are written into a mapping file.

    Attributes:
        options: Option -> value as text.
        remarks: Option -> source of the value, or what a person should check.
        unused: Column that has no role -> the reason.
    """

    options: Mapping[str, str]
    remarks: Mapping[str, str]
    unused: Mapping[str, str] = field(default_factory=dict)

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
        why = self.unused.__getitem__
        for reason, names in groupby(sorted(self.unused, key=why), why):
            start = " " if reason.startswith("may be") else " not used: "
            lines.append(f"# {shown(list(map(repr, names)), most=8)}{start}{reason}")
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
    """Guess the options for a folder of frames or channels with a table.

    Args:
        folder: Folder with tables and the files that they name, also in folders directly below.
        params: Options that are known, as NAME=VALUE; they are not guessed.

    Raises:
        UserError: The files do not tell what holds labels and what the signals, or columns do not
            tell where a press was; the sentence says what to write.
    """
    if not folder.is_dir():
        raise UserError(f"{folder} is no folder; give the one that holds the table.")
    given = dict(text.partition("=")[::2] for text in params if not text.endswith("=auto"))
    known = read_options(params)  # an unknown option is named before anything is written
    evidence = Evidence(lambda rows: np.full((len(rows), 1), np.nan), _PROBED, dict(given))
    found = None if known.channels or known.channel_columns else _find_frames(folder, known)
    if found is not None:
        table, column, frames = found
        evidence.give("table", table.path.relative_to(folder).as_posix())
        evidence.give("column", column)
        if frames != folder:
            evidence.give("frames", frames.relative_to(folder).as_posix())
        evidence.signals = _frame_signals(folder, frames, table, column)
        candidates = [name for name in table.columns if name != column]
    else:
        table, candidates = _find_skin(folder, known, evidence)
        evidence.give("surface", "flat", "no table says it; write dome if a dome is pressed")
    for name in given_columns(given):
        table.column(name)  # its error says what the name may stand for
    hidden = table.signals
    candidates = [name for name in candidates if name not in hidden]
    labels = [name for name in candidates if is_numeric(table, name)]
    if found is None and labels and all(_is_flag(table, name) for name in labels):
        whole = [name for name in table.arrays if [*table.select(name)] == labels]
        evidence.give("sites", (whole or [table.listed(labels)])[0], "1 where a place is touched")
    elif not known.sites:
        find_roles(table, labels, evidence)
        find_press(table, candidates, evidence)
        evidence.give("radius_mm", "3.0", "of the tip; no table says it")
    options = evidence.options
    used = {name.removeprefix("-") for text in options.values() for name in text.split(",")}
    used |= {*table.select(options.get("sites", ""))}
    signals = [name for name in table.arrays if f"{name}_1" in hidden]
    for name in (*candidates, *signals):
        if name not in used:
            evidence.unused.setdefault(name, _reason(table, name, name in labels))
    unused = {name: why for name, why in evidence.unused.items() if name not in used}
    return Guess(options, {k: v for k, v in evidence.remarks.items() if k not in given}, unused)


def _is_flag(table: Table, name: str) -> bool:
    """Return whether a column holds nothing but 0 and 1: whether a place is touched."""
    return {*np.unique(table.numbers(name, allow_empty=True)).tolist()} <= {0.0, 1.0}


def _reason(table: Table, name: str, is_numeric: bool) -> str:
    """Return why a column or an array has no role."""
    if name in table.arrays:
        return "another signal"
    if not is_numeric:
        return "no numbers"
    if counts_up(table, name):
        return "it counts up, a time or a counter"
    if np.ptp(table.numbers(name, allow_empty=True)) == 0:
        return "never changes"
    part = take_apart(name)
    return "another quantity" if part.is_else or part.axis else "its name says nothing known"


def _find_frames(folder: Path, known: ImportOptions) -> tuple[Table, str, Path] | None:
    """Return the table that names most frames, its column of names, and the frames' folder."""
    places = frame_places(folder, known.frames)
    video = find_video(folder)
    if video is None and not any(is_picture(path) for place in places for path in place.iterdir()):
        return None
    paths = [inside(folder, known.table)] if known.table else find_tables(folder)
    tables = {path: read_table(path, read_file(path)) for path in paths}
    if video is not None:
        if len(tables) != 1:
            raise UserError(f"{folder} holds a video and {len(tables)} tables; write table=FILE.")
        (table,) = tables.values()
        numbers = [n for n in table.columns if words(n)[:1] == ["frame"] and is_numeric(table, n)]
        return table, next(iter(numbers), ""), folder
    best: dict[tuple[Path, str, Path], dict[Path, None]] = {}  # the files of the first rows
    for path, table in tables.items():
        for column in [table.column(known.column)] if known.column else table.columns:
            for name in filter(None, map(frame_name, map(str, table.cells[column][:_NAMED]))):
                for place, file in find_frame(folder, places, name).items():
                    best.setdefault((path, column, place), {})[file] = None
    if not best:
        names = shown([path.name for path in tables], 8) or "no table"
        raise UserError(
            f"{folder} holds {names}, and no column of a table names files of the folder; write "
            "the names of the frames, with .png, into one. Of a sensor without a camera, name the "
            f"table of its numbers with --param channels=FILE.{_describe_unread(folder)}"
        )
    most = [key for key, files in best.items() if len(files) == max(map(len, best.values()))]
    of = {(path, place, *best[path, column, place]): column for path, column, place in most[::-1]}
    most = [key for key in most if key[1] in of.values()]  # a time may name the same files
    usual = [k for k in most if k[2] in (folder, k[0].parent) or k[2].name in FRAME_FOLDERS]
    most = (usual[:1] if len({key[:2] for key in most}) == 1 else usual) or most
    if len(most) > 1:
        says = [
            f"table={path.relative_to(folder)} column={column} frames={place.relative_to(folder)}"
            for path, column, place in most
        ]
        raise UserError(
            f"{folder} may be read in {len(most)} ways; choose with --param: "
            f"{' or '.join(says[:4])}{' or others' * (len(says) > 4)}."
        )
    path, column, place = most[0]
    return tables[path], column, place


def _describe_unread(folder: Path) -> str:
    """Return a sentence on files that hold labels maybe, but are not read; "" where none are."""
    names = sorted(path.name for path in folder.iterdir() if path.suffix.lower() in _UNREAD)
    return f" Not read: {shown(names, 4)}; save them as one CSV table." if names else ""


def _frame_signals(
    folder: Path, frames: Path, table: Table, column: str
) -> Callable[[npt.NDArray[np.intp]], FloatArray]:
    """Return the function that gives the pixels of rows, NaN where a frame cannot be read."""
    names: Sequence[str] = list(map(frame_name, map(str, table.cells[column]))) if column else ()
    if (video := find_video(folder)) is not None:
        frames = video_frames(video)
        names = video_names(table, column, frames)

    @cache
    def pixels(row: int) -> FloatArray | None:
        with suppress(UserError):  # reported when the frame is imported
            (path,) = find_frame(folder, [frames], names[row]).values() or [Path()]
            kind, bits = check_picture(path, read_file(path))
            return read_picture(path, kind, max(8, bits))[::2, ::2].astype(np.float64).ravel()
        return None

    def signals(rows: npt.NDArray[np.intp]) -> FloatArray:
        found = [pixels(int(row)) for row in rows]
        size = next((len(image) for image in found if image is not None), 1)
        lost = np.full(size, np.nan)
        return np.stack([lost if i is None or len(i) != size else i for i in found])

    return signals


def _find_skin(folder: Path, known: ImportOptions, evidence: Evidence) -> tuple[Table, list[str]]:
    """Find the labels and the channels of a sensor without a camera, in one table or in two.

    Returns:
        The labels, and the columns of their table that are no channels.

    Raises:
        UserError: The tables do not tell which is which.
    """
    given = [inside(folder, name) for name in dict.fromkeys((known.table, known.channels)) if name]
    whole = bool(known.table and known.channels) or (bool(given) and bool(known.channel_columns))
    tables = {path: read_table(path, read_file(path)) for path in given}
    if not whole and not (known.table and not known.channels and channels_of(tables[given[0]])):
        others = [path for path in find_tables(folder) if path not in given]
        tables |= {path: read_table(path, read_file(path)) for path in others}
    if not tables:
        raise UserError(f"{folder} holds no frames and no table.{_describe_unread(folder)}")
    labels = [given[0]] if known.table else [p for p in tables if p not in given] or given
    if len(tables) > 1 and not known.table:
        few = [p for p in labels if len(_label_columns(tables[p])) <= _MOST_LABELS]
        placed = [p for p in few if {"x", "y"} <= {*map(_axis, tables[p].columns)}]
        labels = placed or [p for p in few if not channels_of(tables[p])] or few
    signals = given[-1:] if known.channels else [p for p in tables if p not in labels] or labels
    rows = {len(tables[path]) for path in labels}
    signals = [p for p in signals if len(signals) == 1 or len(tables[p]) in rows]
    if len(labels) != 1 or len(signals) != 1:
        what = [f"table={shown([p.name for p in labels or tables], 8)}"] * (len(labels) != 1)
        what += [f"channels={shown([p.name for p in signals], 8)}"] * (len(signals) != 1)
        raise UserError(
            f"{folder} holds {len(tables)} tables; say which file holds the labels and which the "
            f"channels with --param table=FILE --param channels=FILE ({'; '.join(what)})."
        )
    table, source = tables[labels[0]], tables[signals[0]]
    source.select(known.channels_time)
    for role, path in (("table", labels[0]), ("channels", signals[0])):
        evidence.give(role, path.relative_to(folder).as_posix())
    same = source is table
    chosen = known.channel_columns or (channels_of(source) if same or source.arrays else "")
    columns = list(source.select(chosen) if chosen else _label_columns(source))
    if same and not chosen:
        raise UserError(
            f"{table.path} does not tell which columns are the channels; say it with --param "
            f"channel_columns=FIRST:LAST; its columns are {shown(table.columns)}."
        )
    clocks = [
        [c for c in t.columns if is_numeric(t, c) and counts_up(t, c)][:1] for t in (table, source)
    ]
    if not same and all(clocks) and not known.join:
        evidence.give("join", clocks[0][0], "it counts up in both files, as a time does")
        if clocks[0] != clocks[1]:
            evidence.give("channels_time", clocks[1][0])
    if chosen or ("join" not in evidence.options and len(columns) < len(source.columns)):
        chosen = chosen or source.listed(columns)
        evidence.give("channel_columns", chosen, f"{len(columns):,} channels")
        reason = f"no channel of {source.path.name}, but a time or text"
        left = {*source.columns} - {*columns} if not same else ()
        evidence.unused |= dict.fromkeys(left, reason)
    before = chosen.replace("after", "before")
    if before != chosen and before in source.arrays:
        evidence.give("before", before, "the channels before a press are subtracted")
    values = np.column_stack([source.numbers(c, allow_empty=True) for c in columns])
    if len(values) == len(table):
        values = (values - values.mean(axis=0)) / np.maximum(values.std(axis=0), 1e-12)
        evidence.signals, evidence.most = lambda rows: values[rows], _MOST_ROWS
    if not same:
        return table, list(table.columns)
    before = evidence.options.get("before", "")
    used = {*columns, *(() if (folder / before).is_file() else table.select(before))}
    return table, [name for name in table.columns if name not in used]


def _axis(column: str) -> str:
    name = take_apart(column)
    return "" if name.is_else else name.axis


def _label_columns(table: Table) -> list[str]:
    """Return the columns of numbers that are no time and no counter."""
    return [n for n in table.columns if is_numeric(table, n) and not counts_up(table, n)]


def channels_of(table: Table) -> str:
    """Return the columns of channels of a table that holds labels, too; "" where none are sure.

    They are the largest array, the largest series of numbered names, or, without names, all columns
    after two that have the few different values of a grid.
    """
    arrays = {name: prod(shape) for name, shape in table.arrays.items() if name != "column"}
    if arrays:
        most = max(arrays.values())
        largest = [name for name in arrays if arrays[name] == most]
        after = [name for name in largest if "after" in name]
        return (after or largest)[0] if most >= _LEAST_SERIES else ""
    columns = _label_columns(table)
    if table.header:
        stems = Counter(stem(name) for name in columns if stem(name))
        ranked = stems.most_common(2)
        if (
            not ranked
            or ranked[0][1] < _LEAST_SERIES
            or (len(ranked) > 1 and ranked[1][1] * 2 > ranked[0][1])
        ):
            return ""
        return table.listed([name for name in columns if stem(name) == ranked[0][0]])
    few = [len(np.unique(table.numbers(n, allow_empty=True))) < _GRID * len(table) for n in columns]
    first = few.index(False) if False in few else len(few)
    if first < 2 or len(columns) - first < _LEAST_SERIES or any(few[first:]):
        return ""
    return f"{columns[first]}:{columns[-1]}"
