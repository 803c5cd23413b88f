"""Recorded folders: the steps that all formats have in common, and the import into a data set.

Frames are looked for inside their folder only; every file is read once, checked and hashed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt

import tactibench
from tactibench.contacts import Signal
from tactibench.datasets.dataset import Dataset, open_dataset
from tactibench.datasets.formats import (
    FORMATS,
    READERS,
    V1,
    FolderContent,
    check_folder,
    find_format,
    recording_folder,
)
from tactibench.datasets.labels import (
    choose_indenter,
    may_be_empty,
    named_columns,
    role_columns,
    scenes_of,
)
from tactibench.datasets.options import AUTO, NONE, REFUSE, ImportOptions
from tactibench.datasets.recording import (
    SOURCE_NAME,
    FloatArray,
    Recording,
    prepare_frames,
    read_dataset,
)
from tactibench.datasets.schema import ChannelKind, Draft, Header
from tactibench.datasets.tables import Table
from tactibench.datasets.writer import Writer, is_plain_png, new_folder
from tactibench.errors import UserError, did_you_mean, is_full
from tactibench.png import ImageKind, check_png, read_file

_MOSTLY_NUMBERS = 0.5
"""A column of which this share are numbers is meant as numbers; its other cells are mistakes."""
_SAME_PLACE = 0.01
"""Numbers that are no further apart are one place, mm or deg: robots come back to a few um."""
_BITS_AT, _MOST_BITS = 24, 8
"""Place of the byte in a PNG that holds the bits per channel, and the most bits of a frame."""
_BATCH = 250
"""Frames that are read, checked and written together."""

Advance = Callable[[int], None]


def open_recording(
    folder: Path,
    options: ImportOptions | None = None,
    format: str | None = None,  # noqa: A002
) -> Recording:
    """Read the labels of a folder and check all its files.

    Args:
        folder: A recording of any format, or a data set.
        options: Names of files and columns, and the meaning of the labels; a data set needs none.
        format: One of FORMATS or "v1"; None: it is found from the files.

    Raises:
        UserError: Something is missing or damaged; the sentence names file and row.
    """
    options = options or ImportOptions()
    check_folder(folder)
    folder = recording_folder(folder)
    if options.channels:
        from tactibench.datasets.vectors import read_vectors

        return read_vectors(folder, options)
    format = format or find_format(folder)  # noqa: A001
    if format == V1:
        return read_dataset(folder)
    if format not in READERS:
        raise UserError(f"there is no format {format!r}; {did_you_mean(format, FORMATS)}")
    return _read_frames(READERS[format](folder, options), options)


def _read_frames(content: FolderContent, options: ImportOptions) -> Recording:
    """Find the frames, read the labels, check every file.

    Raises:
        UserError: A frame, a label or a column is missing or wrong; the sentence names it.
    """
    table = content.table
    names = frame_names(table.path, table.cells[content.name_column])
    files = _find_frames(content, names, options.missing)
    rows = [row for row, path in enumerate(files) if path is not None]
    paths = tuple(path for path in files if path is not None)
    rest = _find_rest(content.rest_folder, set(paths))
    facts = read_labels(
        table, names, rows, options, name=content.name_column, columns=content.label_columns
    )
    kind, sha256 = check_frames(content.data, paths, rest)
    left_out = len(names) - len(rows)
    skipped = [f"rows of {table.path.name} left out, no file: {left_out:,}."] if left_out else []
    recording = Recording(
        format=content.format,
        generation=content.generation,
        folder=content.folder,
        table=table.path,
        paths=paths,
        frames=content.frame_folders[0],
        stored=kind,
        rest=rest,
        sha256=sha256,
        about=content.about,
        notes=(*content.notes, *skipped),
        **facts,
    )
    return prepare_frames(recording, options.light)


def read_labels(
    table: Table,
    names: Sequence[str],
    rows: Sequence[int],
    options: ImportOptions,
    *,
    name: str = "",
    columns: Sequence[str] | None = None,
) -> dict[str, Any]:
    """Return the fields of a recording that come from the labels of its table.

    Args:
        table: The table.
        names: Name of the frame of every row; each is a press of its own unless the options name
            columns.
        rows: Rows that become frames.
        options: Names of columns, and the meaning of the labels.
        name: Column that names the frames.
        columns: Columns that must be numbers; None: all columns that are mostly numbers.

    Raises:
        UserError: A column is missing, a cell is no number, or labels describe no scene that can
            be.
    """
    if options.labels != AUTO:
        columns = [table.column(text.strip()) for text in options.labels.split(",") if text]
    elif columns is None:
        others = {name, options.press, options.join}
        mostly = (c for c in table.columns if table.numeric_share(c) >= _MOSTLY_NUMBERS)
        columns = [column for column in mostly if column not in others]
    indenter = choose_indenter(options, columns)
    empty = may_be_empty(options, indenter)
    needed = empty | named_columns(options, indenter)  # read even where cells are no numbers
    columns = tuple(dict.fromkeys([*columns, *(c for c in table.columns if c in needed)]))
    labels = {column: table.numbers(column, allow_empty=column in empty) for column in columns}
    roles = role_columns(options, indenter, labels, table.path)
    scenes = scenes_of(labels, roles, options, indenter, table.path)
    presses = read_presses(table, options) or names
    return {
        "names": tuple(names[row] for row in rows),
        "labels": {column: values[rows] for column, values in labels.items()},
        "scenes": tuple(None if scenes is None else scenes[row] for row in rows),
        "presses": tuple(presses[row] for row in rows),
        "columns": {"name": name, **roles} if name else roles,
        "extra": {
            column: tuple(table.cells[column].iloc[list(rows)])
            for column in table.columns
            if column not in {*columns, name}
        },
        "dome_radius_mm": None if indenter == NONE else options.surface_radius_mm,
    }


def read_presses(table: Table, options: ImportOptions) -> tuple[str, ...] | None:
    """Return the press of every row: rows that agree in all named columns share one.

    Texts agree where they are equal, numbers where a robot came back to one place. A press is named
    after the cells of its first row. None where the options name no column.
    """
    if not options.press:
        return None
    columns = [table.column(name.strip()) for name in options.press.split(",")]
    cells = [" ".join(row) for row in zip(*(table.cells[name] for name in columns), strict=True)]
    numbers = [
        table.numbers(name)
        if table.numeric_share(name) == 1
        else np.unique(list(table.cells[name]), return_inverse=True)[1]
        for name in columns
    ]
    first: dict[int, str] = {}
    groups = _same_places(np.column_stack(numbers))
    return tuple(
        first.setdefault(group, cell) for group, cell in zip(groups.tolist(), cells, strict=True)
    )


def _same_places(points: FloatArray) -> npt.NDArray[np.int64]:
    """Return the (N,) groups of (N, K) points that are one place along every axis."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    places, place_of = np.unique(points, axis=0, return_inverse=True)
    close = cKDTree(places).query_pairs(_SAME_PLACE, p=np.inf, output_type="ndarray")
    count = len(places)
    links = coo_array((np.ones(len(close)), (close[:, 0], close[:, 1])), shape=(count, count))
    _, group = connected_components(links, directed=False)
    return np.asarray(group[place_of.ravel()], dtype=np.int64)


def frame_names(path: Path, cells: Iterable[str]) -> tuple[str, ...]:
    """Return the names of frames with '/' as separator, in the order of the table.

    Raises:
        UserError: A name is empty, leads out of its folder, or is listed twice.
    """
    row_of: dict[str, int] = {}
    for row, cell in enumerate(cells, start=1):
        name = _relative_name(path, row, cell)
        if name in row_of:
            raise UserError(
                f"{path} rows {row_of[name]} and {row} both name the frame {name}; "
                "a frame may be listed once."
            )
        row_of[name] = row
    return tuple(row_of)


def _relative_name(path: Path, row: int, cell: str) -> str:
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


def _find_frames(content: FolderContent, names: Sequence[str], missing: str) -> list[Path | None]:
    """Return the file of every name; where ``missing`` is SKIP, None for a missing file."""
    folders = content.frame_folders
    places = ([folder / name for folder in folders] for name in names)
    paths = [next((path for path in found if path.is_file()), None) for found in places]
    absent = [name for name, path in zip(names, paths, strict=True) if path is None]
    if absent and (missing == REFUSE or len(absent) == len(names)):
        many = len(absent) > 1
        raise UserError(
            f"{content.table.path} names {len(absent)} frame{'s' if many else ''} that "
            f"{'are' if many else 'is'} not in {folders[0]}, first {absent[0]}; "
            "add the files or remove their rows."
        )
    return paths


def _find_rest(folder: Path, listed: set[Path]) -> Path | None:
    """Return init_0.png, another *init*.png, or the image_0.png of newer recordings."""
    paths = [folder / "init_0.png", *sorted(folder.glob("*init*.png")), folder / "image_0.png"]
    return next((path for path in paths if path not in listed and path.is_file()), None)


def check_frames(table: bytes, paths: Sequence[Path], rest: Path | None) -> tuple[ImageKind, str]:
    """Read every file once.

    Args:
        table: Bytes of the table.
        paths: Files of the frames, at least one.
        rest: File of the undeformed frame.

    Returns:
        Size and colours of every frame, and the sha256 over the table, all frames and the rest
        frame.

    Raises:
        UserError: A frame is no sound PNG of 8 bits, or differs from the others.
    """
    digest = hashlib.sha256(table)
    first: ImageKind | None = None
    for path in (*paths, rest):
        if path is None:
            continue
        data = read_file(path)
        kind = check_png(path, data)
        if data[_BITS_AT] > _MOST_BITS:
            raise UserError(
                f"{path} has {data[_BITS_AT]} bits a pixel; frames have 8: convert them first."
            )
        first = first or kind
        if kind != first:
            raise UserError(
                f"{path} is {kind}, but {paths[0].name} is {first}; "
                "all frames of a recording, the rest frame included, must be alike."
            )
        # The length keeps two files from passing for one.
        digest.update(len(data).to_bytes(8, "little"))
        digest.update(data)
    assert first is not None, "a table has at least one row"  # noqa: S101
    return first, digest.hexdigest()


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
        extra={**extra, SOURCE_NAME: recording.names[row]},
    )


def _stored_signal(recording: Recording, row: int) -> bytes | Signal:
    """Return an image's file as it is, where a data set may hold it; otherwise the signal."""
    if recording.paths and recording.view is None:
        data = read_file(recording.paths[row])
        if is_plain_png(data):
            return data
    return recording.signal(row)
