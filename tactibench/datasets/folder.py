"""Recorded folders of any format: opening, and the import into a data set.

Labels and channels of a sensor without a camera lie in one table or in two. Their rows belong
together in order, or by a time that both have.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

import tactibench
from tactibench.contacts import Signal
from tactibench.datasets.formats import (
    inside,
    read_frames,
    read_labels,
    recording_folder,
    refuse_frozen,
    table_path,
)
from tactibench.datasets.labels import AUTO, SKIP, ImportOptions
from tactibench.datasets.recording import (
    SOURCE_NAME,
    FloatArray,
    Recording,
    prepare_channels,
    read_dataset,
)
from tactibench.datasets.schema import ChannelKind, Dataset, Draft, Header, is_dataset, open_dataset
from tactibench.datasets.tables import Table, read_table, shown
from tactibench.datasets.writer import Writer, is_plain_png, new_folder
from tactibench.errors import UserError, read_file

_BATCH = 250
"""Frames that are read, checked and written together."""
_EPOCHS = (1e11, 1e14, 1e17)
"""Times since 1970 above which they are ms, us and ns: in s they have ten digits."""
_SATURATED = 0.01
"""Share of the rows that may stand at a channel's largest or smallest value. A sensor that is not
at its limit returns to one extreme number far more seldom."""


def open_recording(folder: Path, options: ImportOptions | None = None) -> Recording:
    """Read the labels of a folder and check all its files.

    Args:
        folder: A recording of any format, or a data set.
        options: Names of files and columns, and the meaning of the labels; a data set needs none.

    Raises:
        UserError: Something is missing or damaged; the sentence names file and row.
    """
    options = options or ImportOptions()
    folder = recording_folder(folder)
    if options.channels:
        return prepare_channels(read_vectors(folder, options))
    if not is_dataset(folder):
        return read_frames(folder, options)
    if options.light != AUTO:
        raise UserError(
            f"{folder} is a data set, whose frames are as they were imported; leave light out, or "
            f"import the recording again with --param light={options.light}."
        )
    return read_dataset(folder)


def import_folder(
    source: Path | Recording,
    target: Path,
    options: ImportOptions | None = None,
    advance: Callable[[int], None] = lambda _: None,
) -> Dataset:
    """Import a recording into a new data set.

    Frames that are 8-bit gray or RGB PNG files are copied byte for byte. Everything is written
    beside the target and takes its name at the end.

    Args:
        source: A folder, or a recording that was opened with the same options.
        target: Folder of the new data set.
        options: Names of files and columns, and the meaning of the labels.
        advance: Called with the number of frames that were written.

    Raises:
        UserError: Something is missing or damaged; the sentence names file and row.
        OSError: The target cannot be written.
    """
    options = options or ImportOptions()
    recording = source if isinstance(source, Recording) else open_recording(source, options)
    if recording.dataset is not None:
        raise UserError(f"{recording.folder} is a data set of this format already; copy it.")
    with (
        new_folder(target, recording.folder) as folder,
        Writer(folder, _header(recording, options), fsync=False) as writer,
    ):
        rest = recording.rest_signal()  # its error names a file that cannot be decoded
        if rest is not None:
            data = b"" if recording.rest is None else read_file(recording.rest)
            copied = is_plain_png(data) and recording.view is None
            writer.reference(data if copied else rest)
        for start in range(0, len(recording), _BATCH):
            rows = range(start, min(start + _BATCH, len(recording)))
            try:
                writer.add_many([_draft(recording, row) for row in rows])
            except UserError:
                for row in rows:  # this error names the file
                    recording.signal(row)
                raise
            advance(len(rows))
    return open_dataset(target)


def _header(recording: Recording, options: ImportOptions) -> Header:
    kind = recording.kind
    channels = kind.shape if isinstance(kind, ChannelKind) else ()
    folder = recording.folder.resolve().name
    return Header(
        options.name or folder,
        {"name": options.sensor or folder},
        None if isinstance(kind, ChannelKind) else (kind.height, kind.width),
        recording.channels,
        recording.dome_radius_mm,
        channels,
        recording.signal_names,
        recording.sites,
        licence=options.licence,
        source={
            "importer": f"tactibench {tactibench.__version__}",
            "format": recording.format,
            "generation": recording.generation,
            "options": options.changed(),
            "columns": dict(recording.columns),
            "sha256": recording.sha256,
            "notes": list(recording.notes),
            "files": dict(recording.about),
        },
    )


def _draft(recording: Recording, row: int) -> Draft:
    extra: dict[str, Any] = {name: cells[row] for name, cells in recording.extra.items()}
    return Draft(
        _stored_signal(recording, row),
        row,
        recording.scenes[row],
        {n: float(v[row]) for n, v in recording.labels.items() if not np.isnan(v[row])},
        recording.presses[row],
        session=recording.sessions[row] if recording.sessions else "",
        extra={**extra, SOURCE_NAME: recording.names[row]},
        contacts_force_n=recording.forces[row],
    )


def _stored_signal(recording: Recording, row: int) -> bytes | Signal:
    """Return an image's file as it is, where a data set may hold it; otherwise the signal."""
    copied = recording.paths and recording.view is None
    data = read_file(recording.paths[row]) if copied else b""
    return data if is_plain_png(data) else recording.signal(row)


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
    path = table_path(folder, options.table, channel_path)
    data, channel_data = read_file(path), read_file(channel_path)
    table = read_table(path, data)
    source = table if path == channel_path else read_table(channel_path, channel_data)
    names = _channel_columns(source, options, alone=source is not table)
    values = _numbers(source, names)
    used = set(names)
    if options.before:
        rest, columns = _at_rest(folder, source, options)
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
                f"{first.frames.name} {first.stored} and {shown([*first.labels])}; take one by one."
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


def _at_rest(folder: Path, source: Table, options: ImportOptions) -> tuple[FloatArray, set[str]]:
    """Return the channels before every press, of columns or of a file, and their columns."""
    if (folder / options.before).is_file():
        path = inside(folder, options.before)
        source = read_table(path, read_file(path))
        return _numbers(source, _channel_columns(source, ImportOptions(), alone=True)), set()
    names = source.select(options.before)
    return _numbers(source, names), set(names)


def _times(source: Table, options: ImportOptions) -> FloatArray | None:
    """Return the times of the channels' rows; None where rows are joined in order."""
    name = options.channels_time or options.join
    return _seconds(source, source.column(name)) if options.join else None


def _seconds(table: Table, column: str) -> FloatArray:
    """Return times in s; ms, us and ns are told by the name, or of an epoch by their size."""
    times = table.numbers(column)
    stated = re.split(r"[\W_]+", column.rstrip(")] "))[-1].lower()
    thousands = {"ms": 1, "millis": 1, "us": 2, "ns": 3, "nsec": 3}.get(stated, 0)
    return times / 1e3 ** (thousands or int(np.searchsorted(_EPOCHS, np.median(times))))


def _join(
    table: Table, values: FloatArray, times: FloatArray | None, path: Path, options: ImportOptions
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
    wanted = _seconds(table, table.column(options.join))
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
            f"({len(alone):,} such rows); correct the times, or leave them out with missing=skip."
        )
    near = np.flatnonzero(apart_ms <= options.tolerance_ms)
    return near.tolist(), joined["partner"].to_numpy()[near].tolist()


def stuck_channels(values: npt.NDArray[Any]) -> tuple[npt.NDArray[np.bool_], FloatArray]:
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
        columns = f"its columns are {table.columns[0]} to {table.columns[-1]}"
        notes.append(f"{table.path.name} has no header line; {columns}.")
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
