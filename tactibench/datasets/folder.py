"""Recorded folders of any format: opening, and the import into a data set."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import tactibench
from tactibench.contacts import Signal
from tactibench.datasets.dataset import Dataset, open_dataset
from tactibench.datasets.formats import read_frames, recording_folder
from tactibench.datasets.options import AUTO, ImportOptions
from tactibench.datasets.recording import SOURCE_NAME, Recording, prepare_channels, read_dataset
from tactibench.datasets.schema import ChannelKind, Draft, Header, is_dataset
from tactibench.datasets.vectors import read_vectors
from tactibench.datasets.writer import Writer, is_plain_png, new_folder
from tactibench.errors import UserError
from tactibench.png import read_file

_BATCH = 250
"""Frames that are read, checked and written together."""


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
    return Header(
        options.name or recording.folder.resolve().name,
        {"name": options.sensor},
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
        {
            name: float(values[row])
            for name, values in recording.labels.items()
            if values[row] == values[row]  # NaN: this frame has no such label
        },
        recording.presses[row],
        session=recording.sessions[row] if recording.sessions else "",
        extra={**extra, SOURCE_NAME: recording.names[row]},
        contacts_force_n=recording.forces[row],
    )


def _stored_signal(recording: Recording, row: int) -> bytes | Signal:
    """Return an image's file as it is, where a data set may hold it; otherwise the signal."""
    if recording.paths and recording.view is None:
        data = read_file(recording.paths[row])
        if is_plain_png(data):
            return data
    return recording.signal(row)
