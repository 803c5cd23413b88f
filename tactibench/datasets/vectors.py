"""A folder of a sensor without a camera: one file of labels, one of channels.

Both are CSV files, with or without a header line, or NumPy archives (.npz, .npy). Their rows belong
together in order, or by a time that both have.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from tactibench.datasets.formats import read_labels
from tactibench.datasets.options import SKIP, ImportOptions
from tactibench.datasets.recording import FloatArray, Recording
from tactibench.datasets.schema import ChannelKind
from tactibench.datasets.tables import Table, read_table
from tactibench.errors import UserError
from tactibench.png import read_file

_SATURATED = 0.01
"""Share of the rows that may stand at a channel's largest or smallest value. A sensor that is not
at its limit returns to one extreme number far more seldom."""
_ARCHIVES = (".npz", ".npy")


def read_vectors(folder: Path, options: ImportOptions) -> Recording:
    """Read labels and channels.

    Args:
        folder: The folder of both files.
        options: Names of the files (``table``, ``channels``), the column that joins their rows
            (``join``), and the meaning of the labels.

    Raises:
        UserError: A file is missing or damaged, the rows do not belong together, or a channel is
            no finite number. The sentence names file, row and column.
    """
    channel_path = _inside(folder, options.channels)
    table, data = read_label_table(folder, options)
    channel_data = read_file(channel_path)
    values, times, names = _read_channels(channel_path, channel_data, options)
    rows, partners = _join(table, values, times, channel_path, options)
    frames = tuple(f"row-{row + 1:06d}" for row in range(len(table)))
    partner_values = values[partners]
    return Recording(
        format="channels",
        generation=f"{table.path.name}, {channel_path.name}",
        folder=folder,
        table=table.path,
        paths=(),
        frames=channel_path,
        stored=ChannelKind(values.shape[1:]),
        rest=None,
        sha256=hashlib.sha256(len(data).to_bytes(8, "little") + data + channel_data).hexdigest(),
        notes=_notes(table, len(table) - len(rows), partner_values, names),
        **read_labels(table, frames, rows, options),
        values=partner_values,
        signal_names=names,
    )


def read_label_table(folder: Path, options: ImportOptions) -> tuple[Table, bytes]:
    """Return the labels and the bytes of their file.

    The one-dimensional arrays of an archive are its columns.

    Args:
        folder: The folder of labels and channels.
        options: Names of the files (``table``, ``channels``).

    Raises:
        UserError: A file is missing or damaged, or several files may hold the labels.
    """
    path = _label_file(folder, options.table, _inside(folder, options.channels))
    data = read_file(path)
    if path.suffix not in _ARCHIVES:
        return read_table(path, data), data
    columns = {name: array for name, array in _arrays(path, data).items() if array.ndim == 1}
    lengths = {len(array) for array in columns.values()}
    if len(lengths) != 1 or 0 in lengths:
        raise UserError(
            f"{path} holds no columns of labels; give one-dimensional arrays of one length above 0."
        )
    cells = {name: [repr(v) for v in array.tolist()] for name, array in columns.items()}
    return Table(path, pd.DataFrame(cells, dtype=str)), data


def _inside(folder: Path, name: str) -> Path:
    path = folder / name
    if not path.resolve().is_relative_to(folder.resolve()):
        raise UserError(f"{path} lies outside of {folder}; name a file in it.")
    if not path.is_file():
        files = ", ".join(sorted(p.name for p in folder.iterdir() if p.is_file())) or "no file"
        raise UserError(f"{folder} holds no {name}; there is {files}.")
    return path


def _label_file(folder: Path, name: str, channels: Path) -> Path:
    if name:
        return _inside(folder, name)
    others = sorted(path for path in folder.glob("*.csv") if path != channels)
    if len(others) == 1:
        return others[0]
    names = ", ".join(path.name for path in others) or "no other CSV file"
    raise UserError(
        f"{folder} holds {names} beside {channels.name}; name the file of the labels with "
        "--param table=FILE."
    )


def _arrays(path: Path, data: bytes) -> dict[str, npt.NDArray[np.float64]]:
    """Return the arrays of numbers in a NumPy file by their names; nothing is unpickled."""
    try:
        loaded = np.load(io.BytesIO(data), allow_pickle=False)
        arrays = {"": loaded} if isinstance(loaded, np.ndarray) else dict(loaded)
        return {name: np.asarray(array, dtype=np.float64) for name, array in arrays.items()}
    except (ValueError, TypeError, OSError, EOFError, zipfile.BadZipFile) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise UserError(f"{path} holds no arrays of numbers: {reason}.") from None


def _read_channels(
    path: Path, data: bytes, options: ImportOptions
) -> tuple[npt.NDArray[np.float32], FloatArray | None, tuple[str, ...]]:
    """Return channels (N, ...), the times of their rows where rows are joined by time, and names.

    In an archive, the array with most numbers holds the channels.
    """
    join = options.channels_time or options.join
    names: tuple[str, ...] = ()
    if path.suffix in _ARCHIVES:
        arrays = _arrays(path, data)
        signals = [array for name, array in arrays.items() if not join or name != join]
        values = max(signals, key=lambda array: array.size, default=np.empty(0))
        if options.join and join not in arrays:
            raise UserError(f"{path} has no array {join!r}; it has {', '.join(arrays) or 'none'}.")
        times = arrays[join] if options.join else None
    else:
        table = read_table(path, data)
        times = table.numbers(table.column(join)) if options.join else None
        chosen = [name.strip() for name in options.channel_columns.split(",") if name.strip()]
        names = tuple(
            table.column(name) for name in chosen or table.columns if chosen or name != join
        )
        columns = [table.numbers(name) for name in names]
        values = np.column_stack(columns) if columns else np.empty(0)
    if values.ndim < 2 or not values.size:
        what = f"an array of shape {values.shape}" if values.size else "no channels"
        raise UserError(f"{path} holds {what}; channels are (N, C).")
    if times is not None and (times.shape != values.shape[:1] or not np.isfinite(times).all()):
        raise UserError(
            f"{path}: the times {join!r}, of shape {times.shape}, must be one finite number for "
            f"each of the {len(values):,} rows of channels; correct them."
        )
    _refuse_not_finite(path, values, names)
    return values.astype(np.float32), times, names


def _refuse_not_finite(path: Path, values: FloatArray, names: Sequence[str]) -> None:
    flat = values.reshape(len(values), -1)
    bad = np.argwhere(~np.isfinite(flat.astype(np.float32)))
    if len(bad):
        row, column = bad[0].tolist()
        name = names[column] if names else f"channel {column + 1}"
        raise UserError(
            f"{path} row {row + 1}: {name} is {flat[row, column]:g}, but a channel must be a "
            f"finite number ({len(bad)} such value{'s' if len(bad) > 1 else ''}); remove the rows."
        )


def _join(
    table: Table,
    values: npt.NDArray[np.float32],
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


def _notes(
    table: Table, skipped: int, values: npt.NDArray[np.float32], names: Sequence[str]
) -> tuple[str, ...]:
    notes = []
    if not table.header:
        first, last = table.columns[0], table.columns[-1]
        notes.append(f"{table.path.name} has no header line; its columns are {first} to {last}.")
    if skipped:
        notes.append(f"{skipped:,} rows of {table.path.name} left out: no channels at their time.")
    flat = values.reshape(len(values), -1)
    low, high = flat.min(axis=0), flat.max(axis=0)
    constant = low == high
    at_limit = np.maximum((flat == low).mean(axis=0), (flat == high).mean(axis=0))
    saturated = ~constant & (at_limit > max(_SATURATED, 2.5 / len(flat)))
    for column in np.flatnonzero(constant | saturated).tolist():
        name = names[column] if names else f"channel {column + 1}"
        stuck = f"stands at its limit in {at_limit[column]:.0%} of the rows"
        notes.append(f"{name} {'never changes' if constant[column] else stuck}.")
    return tuple(notes)
