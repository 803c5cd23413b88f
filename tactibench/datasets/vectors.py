"""A folder of a sensor without a camera: labels and channels, in one table or in two.

Their rows belong together in order, or by a time that both have.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from tactibench.datasets.formats import find_tables, inside, read_labels, refuse_frozen
from tactibench.datasets.options import SKIP, ImportOptions
from tactibench.datasets.recording import FloatArray, Recording
from tactibench.datasets.schema import ChannelKind
from tactibench.datasets.tables import Table, read_table, shown
from tactibench.errors import UserError
from tactibench.png import read_file

_SATURATED = 0.01
"""Share of the rows that may stand at a channel's largest or smallest value. A sensor that is not
at its limit returns to one extreme number far more seldom."""


def read_vectors(folder: Path, options: ImportOptions) -> Recording:
    """Read labels and channels.

    Args:
        folder: The folder of both.
        options: Names of the files (``table``, ``channels``), the column that joins their rows
            (``join``), the channels at rest that are subtracted (``before``), and the meaning of
            the labels.

    Raises:
        UserError: A file is missing or damaged, the rows do not belong together, or a channel is
            no finite number. The sentence names file, row and column.
    """
    if "*" in options.channels:
        return _join_sessions(folder, options)
    channel_path = inside(folder, options.channels)
    table, data = read_label_table(folder, options)
    path = table.path
    channel_data = read_file(channel_path)
    source = table if path == channel_path else read_table(channel_path, channel_data)
    names = _channel_columns(source, options, alone=source is not table)
    values = _numbers(source, names)
    used = set(names)
    if options.before:
        rest, columns = _rest_values(folder, source, options)
        if rest.shape != values.shape:
            raise UserError(
                f"before={options.before} holds {rest.shape[0]:,} rows of {rest.shape[1]} channels "
                f"at rest, but the channels are {values.shape[0]:,} of {values.shape[1]}; name the "
                "channels before every press, in the same order."
            )
        values = values - rest
        used |= columns
    times = _times(source, options)
    rows, partners = _join(table, values, times, channel_path, options)
    frames = tuple(f"row-{row + 1:06d}" for row in range(len(table)))
    shape = source.shape(names)
    signals = values[partners].astype(np.float32).reshape(-1, *shape)
    others = used if source is table else ()
    facts = read_labels(table, frames, rows, options, others=others)
    refuse_frozen(path, signals, rows, facts)
    return Recording(
        format="channels",
        generation=", ".join(dict.fromkeys((path.name, channel_path.name))),
        folder=folder,
        table=path,
        paths=(),
        frames=channel_path,
        stored=ChannelKind(shape),
        rest=None,
        sha256=hashlib.sha256(len(data).to_bytes(8, "little") + data + channel_data).hexdigest(),
        notes=facts.pop("notes") + _notes(table, len(table) - len(rows), signals, names),
        **facts,
        values=signals,
        signal_names=() if source.arrays else names,
    )


def _join_sessions(folder: Path, options: ImportOptions) -> Recording:
    """Return the recording of several files of channels, each of which is a session.

    Raises:
        UserError: There is no such file, or the files have other channels or labels.
    """
    paths = sorted(path for path in folder.glob(options.channels) if path.is_file())
    if not paths:
        raise UserError(f"{folder} holds no file {options.channels}; name the files of channels.")
    parts = [
        read_vectors(folder, replace(options, channels=p.name, table=options.table or p.name))
        for p in paths
    ]
    first = parts[0]
    for part in parts:
        if (part.stored, [*part.labels]) != (first.stored, [*first.labels]):
            raise UserError(
                f"{part.frames} has {part.stored} and labels {shown([*part.labels])}, but "
                f"{first.frames.name} {first.stored} and {shown([*first.labels])}; import the "
                "files one by one."
            )

    def named(texts: Callable[[Recording], Sequence[str]]) -> tuple[str, ...]:
        return tuple(f"{part.frames.stem}/{text}" for part in parts for text in texts(part))

    return replace(
        first,
        generation=", ".join(part.generation for part in parts),
        names=named(lambda part: part.names),
        presses=named(lambda part: part.presses),
        labels={n: np.concatenate([part.labels[n] for part in parts]) for n in first.labels},
        scenes=tuple(scene for part in parts for scene in part.scenes),
        forces=tuple(force for part in parts for force in part.forces),
        extra={n: tuple(t for part in parts for t in part.extra[n]) for n in first.extra},
        values=np.concatenate([part.values for part in parts if part.values is not None]),
        sha256=hashlib.sha256("".join(part.sha256 for part in parts).encode()).hexdigest(),
        notes=named(lambda part: part.notes),
        sessions=tuple(part.frames.stem for part in parts for _ in part.names),
    )


def read_label_table(folder: Path, options: ImportOptions) -> tuple[Table, bytes]:
    """Return the labels and the bytes of their file.

    Args:
        folder: The folder of labels and channels.
        options: Names of the files (``table``, ``channels``).

    Raises:
        UserError: A file is missing or damaged, or several files may hold the labels.
    """
    path = _label_file(folder, options, inside(folder, options.channels))
    data = read_file(path)
    return read_table(path, data), data


def _label_file(folder: Path, options: ImportOptions, channels: Path) -> Path:
    if options.table:
        return inside(folder, options.table)
    others = [path for path in find_tables(folder) if path != channels]
    if len(others) == 1:
        return others[0]
    if not others:
        return channels
    raise UserError(
        f"{folder} holds {', '.join(path.name for path in others)} beside {channels.name}; name "
        "the file of the labels with --param table=FILE."
    )


def _channel_columns(source: Table, options: ImportOptions, *, alone: bool) -> tuple[str, ...]:
    """Return the columns of the channels; of arrays, the largest one holds them.

    Args:
        source: The table with the channels.
        options: Names of columns.
        alone: Whether the table holds no labels.
    """
    time = options.channels_time or options.join
    names: tuple[str, ...] = tuple(name for name in source.columns if name != time)
    if options.channel_columns:
        names = source.select(options.channel_columns)
    elif source.arrays:
        names = source.select(max(source.arrays, key=lambda name: np.prod(source.arrays[name])))
    elif not alone:
        raise UserError(
            f"{source.path} holds labels and channels; say which columns are the channels with "
            f"--param channel_columns=FIRST:LAST; its columns are {shown(source.columns)}."
        )
    if not names:
        raise UserError(" ".join([f"{source.path} holds no channels.", *source.notes]))
    return names


def _numbers(source: Table, names: Sequence[str]) -> FloatArray:
    """Return the (N, C) values of columns that are channels, which must be finite as float32."""
    values = np.column_stack([source.numbers(name) for name in names])
    bad = np.argwhere(~(np.abs(values) <= np.finfo(np.float32).max))
    if len(bad):
        row, column = bad[0].tolist()
        raise UserError(
            f"{source.path} row {row + 1}: {names[column]} is {values[row, column]:g}, but a "
            "channel must be a number of 32 bits; remove the row."
        )
    return values


def _rest_values(
    folder: Path, source: Table, options: ImportOptions
) -> tuple[FloatArray, set[str]]:
    """Return the channels before every press, of columns or of a file, and their columns."""
    if (folder / options.before).is_file():
        path = inside(folder, options.before)
        source = read_table(path, read_file(path))
        return _numbers(source, _channel_columns(source, ImportOptions(), alone=True)), set()
    names = source.select(options.before)
    return _numbers(source, names), set(names)


def _times(source: Table, options: ImportOptions) -> FloatArray | None:
    """Return the times of the channels' rows; None where rows are joined in order."""
    if not options.join:
        return None
    return source.numbers(source.column(options.channels_time or options.join))


def _join(
    table: Table,
    values: FloatArray,
    times: FloatArray | None,
    path: Path,
    options: ImportOptions,
) -> tuple[list[int], list[int]]:
    """Return rows of the labels, and the row of the channels that belongs to each of them."""
    if times is None:
        if len(values) != len(table):
            raise UserError(
                f"{table.path} has {len(table):,} rows, but {path} {len(values):,}; join them by "
                "a time that both have (--param join=COLUMN), or remove the rows without partner."
            )
        rows = list(range(len(table)))
        return rows, rows
    wanted = table.numbers(table.column(options.join))
    left = pd.DataFrame({"time": wanted, "row": range(len(wanted))}).sort_values("time")
    right = pd.DataFrame({"time": times, "at": times, "partner": range(len(times))})
    right = right.sort_values("time", kind="stable")
    joined = pd.merge_asof(left, right, on="time", direction="nearest").sort_values("row")
    apart_ms = 1e3 * np.abs(joined["at"].to_numpy() - wanted)
    alone = np.flatnonzero(apart_ms > options.tolerance_ms)
    if len(alone) and (options.missing != SKIP or len(alone) == len(table)):
        raise UserError(
            f"{table.path} row {alone[0] + 1}: the nearest row of {path} is "
            f"{apart_ms[alone[0]]:.0f} ms away, more than tolerance_ms={options.tolerance_ms:g} "
            f"({len(alone):,} such rows); "
            "correct the times, or leave those rows out with --param missing=skip."
        )
    near = np.flatnonzero(apart_ms <= options.tolerance_ms)
    return near.tolist(), joined["partner"].to_numpy()[near].tolist()


def stuck_channels(
    values: npt.NDArray[Any],
) -> tuple[npt.NDArray[np.bool_], FloatArray]:
    """Return which of (N, C) channels never change, and the share of rows at a limit, 0 if few."""
    low, high = values.min(axis=0), values.max(axis=0)
    at_limit = np.maximum((values == low).mean(axis=0), (values == high).mean(axis=0))
    at_limit[(low == high) | (at_limit <= max(_SATURATED, 2.5 / len(values)))] = 0.0
    return low == high, at_limit


def _notes(
    table: Table, skipped: int, values: npt.NDArray[np.float32], names: Sequence[str]
) -> tuple[str, ...]:
    notes = []
    if not table.header:
        first, last = table.columns[0], table.columns[-1]
        notes.append(f"{table.path.name} has no header line; its columns are {first} to {last}.")
    if skipped:
        notes.append(f"{skipped:,} rows of {table.path.name} left out: no channels at their time.")
    constant, at_limit = stuck_channels(values.reshape(len(values), -1))
    saturated = at_limit > 0
    for which, verb in ((constant, "never change"), (saturated, "stand at a limit in")):
        if which.any():
            channels = shown([names[at] for at in np.flatnonzero(which).tolist()], most=6)
            share = f" up to {at_limit[which].max():.0%} of the rows" if which is saturated else ""
            notes.append(f"{which.sum():,} of {len(names):,} channels {verb}{share}: {channels}.")
    return tuple(notes)
