"""A recording of another format becomes a v1 data set: whole, or not at all."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import tactibench
from tactibench.datasets import Dataset, Draft, Header, Writer, open_dataset
from tactibench.datasets.exporting.place import new_folder
from tactibench.datasets.importing.opening import V1, open_recording
from tactibench.datasets.importing.options import ImportOptions
from tactibench.datasets.importing.recording import Image, Recording
from tactibench.datasets.importing.stored import SOURCE_NAME
from tactibench.errors import UserError
from tactibench.png import decode_png, read_file

CHUNK = 250
"""Frames that are read, checked and written together."""
_PLAIN = (b"\x08\x00", b"\x08\x02")
"""Bits and colour type of a PNG that is kept byte for byte: 8-bit gray, 8-bit RGB."""
_TRAIN = {
    "train": "train",
    "training": "train",
    "validation": "validation",
    "val": "validation",
    "valid": "validation",
    "dev": "validation",
    "test": "test",
}

Advance = Callable[[int], None]


def import_folder(
    source: Path | Recording,
    target: Path,
    options: ImportOptions | None = None,
    advance: Advance = lambda _: None,
    format: str | None = None,  # noqa: A002
) -> Dataset:
    """Import a folder, or a recording that was opened with the same options, into a new data set.

    Frames that are 8-bit gray or RGB PNG files are kept byte for byte. ``advance`` is told of
    frames as they are written. Everything goes to a folder beside the target that takes its name at
    the end. Raises UserError, naming file and row, and leaves nothing behind.
    """
    options = options or ImportOptions()
    recording = source if isinstance(source, Recording) else open_recording(source, options, format)
    if recording.format == V1:
        raise UserError(f"{recording.folder} is a data set of this format already; copy it.")
    try:
        with new_folder(target, recording.folder) as folder:
            _write(recording, folder, options, advance)
    except OSError as error:
        raise UserError(
            f"{target} cannot be written: {error.strerror or error}; name another place."
        ) from None
    return open_dataset(target)


def header_of(recording: Recording, options: ImportOptions) -> Header:
    """What holds for the whole data set."""
    return Header(
        options.name or recording.folder.resolve().name,
        {"name": options.sensor},
        (recording.kind.height, recording.kind.width),
        recording.channels,
        recording.dome_radius_mm,
        licence=options.licence,
        source={
            "importer": f"tactibench {tactibench.__version__}",
            "format": recording.format,
            "generation": recording.generation,
            "options": options.given(),
            "columns": dict(recording.columns),
            "sha256": recording.sha256,
            "notes": list(recording.notes),
            "files": dict(recording.about),
        },
    )


def _write(recording: Recording, folder: Path, options: ImportOptions, advance: Advance) -> None:
    with Writer(folder, header_of(recording, options), fsync=False) as writer:
        if recording.rest is not None:
            recording.rest_image()  # names the file if it cannot be decoded
            writer.reference(_kept(recording, recording.rest))
        for start in range(0, len(recording), CHUNK):
            rows = range(start, min(start + CHUNK, len(recording)))
            try:
                writer.add_many([_draft(recording, row) for row in rows])
            except UserError:
                for row in rows:  # names the file
                    recording.image(row)
                raise
            advance(len(rows))
        parts = dict(_split(recording))
        if parts:
            writer.split("imported", **parts)


def _draft(recording: Recording, row: int) -> Draft:
    extra: dict[str, Any] = {name: cells[row] for name, cells in recording.extra.items()}
    return Draft(
        _kept(recording, recording.paths[row]),
        row,
        recording.scenes[row],
        {name: float(values[row]) for name, values in recording.labels.items()},
        recording.presses[row],
        extra={**extra, SOURCE_NAME: recording.names[row]},
    )


def _kept(recording: Recording, path: Path) -> bytes | Image:
    """The file as it is, where a data set may hold it; otherwise its image."""
    data = read_file(path)
    return data if data[24:26] in _PLAIN else decode_png(path, data, recording.kind)


def _split(recording: Recording) -> Iterator[tuple[str, list[int]]]:
    """The parts of an image folder that are called as parts of a split are."""
    names = {name: _TRAIN.get(name.lower()) for name in recording.parts}
    if None not in names.values() and len(set(names.values())) == len(names):
        for name, part in names.items():
            yield str(part), list(recording.parts[name])
