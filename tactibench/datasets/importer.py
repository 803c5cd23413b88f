"""Import of a recording into a new data set, completely or not at all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import tactibench
from tactibench.contacts import Signal
from tactibench.datasets.channels import ChannelKind
from tactibench.datasets.dataset import Dataset, open_dataset
from tactibench.datasets.images import is_plain_png
from tactibench.datasets.readers.formats import V1, open_recording
from tactibench.datasets.readers.options import ImportOptions
from tactibench.datasets.readers.recording import SOURCE_NAME, Recording
from tactibench.datasets.schema import Draft, Header
from tactibench.datasets.splits import SUBSETS
from tactibench.datasets.storage import new_folder
from tactibench.datasets.writer import Writer
from tactibench.errors import UserError, is_full
from tactibench.png import read_file

_BATCH = 250
"""Frames that are read, checked and written together."""

Advance = Callable[[int], None]


def import_folder(
    source: Path | Recording,
    target: Path,
    options: ImportOptions | None = None,
    advance: Advance = lambda _: None,
    format: str | None = None,  # noqa: A002
) -> Dataset:
    """Import a recording into a new data set.

    Frames that are 8-bit gray or RGB PNG files are copied byte for byte. Everything is written
    beside the target and takes its name at the end.

    Args:
        source: A folder, or a recording that was opened with the same options.
        target: Folder of the new data set.
        options: Names of files and columns, and the meaning of the labels.
        advance: Called with the number of frames that were written.
        format: Format of the folder; None: it is found from the files.

    Raises:
        UserError: Something is missing or damaged; the sentence names file and row.
    """
    options = options or ImportOptions()
    recording = source if isinstance(source, Recording) else open_recording(source, options, format)
    if recording.format == V1:
        raise UserError(f"{recording.folder} is a data set of this format already; copy it.")
    try:
        with new_folder(target, recording.folder) as folder:
            _write(recording, folder, options, advance)
    except OSError as error:
        if is_full(error):
            raise  # the command line reports that the disk is full
        raise UserError(
            f"{target} cannot be written: {error.strerror or error}; name another place."
        ) from None
    return open_dataset(target)


def _header(recording: Recording, options: ImportOptions) -> Header:
    """Return the header: values of the options first, then those that the folder states."""
    stated: dict[str, Any] = dict(recording.header)
    name = options.name or stated.pop("name", "") or recording.folder.resolve().name
    sensor = stated.pop("sensor", {"name": options.sensor})
    if options.sensor != ImportOptions().sensor:
        sensor = {"name": options.sensor}
    licence = options.licence or stated.pop("licence", "")
    kind = recording.kind
    channels = kind.shape if isinstance(kind, ChannelKind) else ()
    return Header(
        name,
        sensor,
        None if isinstance(kind, ChannelKind) else (kind.height, kind.width),
        recording.channels,
        recording.dome_radius_mm,
        channels,
        recording.signal_names,
        licence=licence,
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
        **{key: stated[key] for key in ("units", "axes", "frames") if key in stated},
    )


def _write(recording: Recording, folder: Path, options: ImportOptions, advance: Advance) -> None:
    with Writer(folder, _header(recording, options), fsync=False) as writer:
        rest = recording.rest_image()  # its error names a file that cannot be decoded
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
        ids = [sample.id for sample in writer.samples]
        for name, split in recording.splits.items():
            subsets = {subset: [ids[row] for row in getattr(split, subset)] for subset in SUBSETS}
            writer.split(name, **subsets)


def _draft(recording: Recording, row: int) -> Draft:
    stated = dict(recording.samples[row]) if recording.samples else {}
    extra: dict[str, Any] = {name: cells[row] for name, cells in recording.extra.items()}
    return Draft(
        _stored_signal(recording, row),
        stated.pop("id", row),
        recording.scenes[row],
        {
            name: float(values[row])
            for name, values in recording.labels.items()
            if values[row] == values[row]  # NaN: this frame has no such label
        },
        recording.presses[row],
        extra={**extra, **stated.pop("extra", {}), SOURCE_NAME: recording.names[row]},
        **stated,
    )


def _stored_signal(recording: Recording, row: int) -> bytes | Signal:
    """Return an image's file as it is, where a data set may hold it; otherwise the signal."""
    if recording.paths and recording.view is None:
        data = read_file(recording.paths[row])
        if is_plain_png(data):
            return data
    return recording.signal(row)
