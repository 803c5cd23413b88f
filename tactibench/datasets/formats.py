"""Recorded folders of frames: their table, the files of the frames, and the labels.

bristol      targets.csv of the Bristol tactile stack. Generations differ in the column that names
             the frames (image_name; sensor_image), in the labels (pose_1 ... pose_6; pose_x ...
             pose_Rz, with shear_* and object_*), in the folder of the frames and in the files that
             say how they were taken (meta.json; *_params.json).
csv          one table that names frames, with labels beside the names; or a video and a table with
             a row for each of its frames.

Frames are looked for inside their folder only, by the last parts of their names where these come
from another machine; every file is read once, checked and hashed.
"""

from __future__ import annotations

import hashlib
import re
import zlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path, PurePosixPath
from string import ascii_uppercase
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from tactibench.contacts import Pose, Scene
from tactibench.datasets.labels import (
    ALIAS,
    AUTO,
    CONTACT_COLUMNS,
    FRAME_FOLDERS,
    NONE,
    REFUSE,
    SINGLE,
    ImportOptions,
    Labels,
    normal_forces,
    role_columns,
    scenes_of,
    shear_columns,
    signed_column,
    tip_columns,
)
from tactibench.datasets.pictures import (
    PICTURES,
    VIDEOS,
    check_picture,
    is_picture,
    is_rest_name,
    video_frames,
)
from tactibench.datasets.recording import FloatArray, Recording, prepare_frames
from tactibench.datasets.schema import Forces, is_dataset
from tactibench.datasets.tables import Table, is_table, read_table, shown
from tactibench.errors import UserError, read_file
from tactibench.geometry import tip_positions
from tactibench.png import ImageKind
from tactibench.records import read_json

TARGETS = ("targets.csv", "targets_images.csv")
NAME_COLUMNS = ("image_name", "sensor_image")
NAMES = ("file_name", "filename", *NAME_COLUMNS, "image", "frame", "file", "path", "name")
"""Columns of a CSV file that may name the frames, in order."""

_ABOUT = ("meta.json", "*_params.json")
_LABEL = re.compile(r"(pose|move|shear|object)_([1-6]|[xyz]|R[xyz])")
_MOSTLY_NUMBERS = 0.5
"""A column of which this share are numbers is meant as numbers; its other cells are mistakes."""
_SAME_PLACE = 0.01
"""Numbers that are no further apart are one place, mm or deg: robots come back to a few um."""
_LONGEST_PLACE = 0.1
"""Extent of rows that are one place; a path of close rows is longer."""
_NOWHERE = 1e6
"""Place of the first row that touches nothing, mm; every other one is as much farther away."""
GATHERED = 0.4
"""Largest ``spacing_in_groups`` of rows that nothing but their places makes one press."""
_FOLLOWS = 0.2
"""The same of each row and the next from which they may be of one slide."""
_FEWEST_RUNS = 10
"""Runs of rows from which they are taken for presses."""
_FEWEST_PLACES = 5
"""Places from which rows are divided by place: of fewer, none would be left to test on."""
_FROZEN = 5
"""Rows with one signal in a row that no sensor gives while presses change; cameras repeat one."""


def find_targets(folder: Path) -> Path | None:
    """Return the table of a folder; None if the folder is no Bristol recording."""
    return next((folder / name for name in TARGETS if (folder / name).is_file()), None)


def recording_folder(folder: Path) -> Path:
    """Return the folder, or the one directly in it that alone is a Bristol recording.

    Raises:
        UserError: This is no folder, or it cannot be listed.
    """
    if not folder.is_dir():
        what = "is a file; give the folder that holds it" if folder.exists() else "does not exist"
        raise UserError(f"{folder} {what}.")
    try:
        below = list(folder.iterdir())
    except OSError as error:
        raise UserError(f"{folder} cannot be listed: {error.strerror}.") from None
    if is_dataset(folder) or any(map(is_table, below)):
        return folder
    inner = [child for child in below if child.is_dir() and find_targets(child)]
    return inner[0] if len(inner) == 1 else folder


def find_tables(folder: Path) -> list[Path]:
    """Return the tables of a folder; where it has none, those of the folders directly in it."""
    here = sorted(filter(is_table, folder.iterdir()))
    below = (path for p in sorted(folder.iterdir()) if p.is_dir() for path in p.iterdir())
    return here or sorted(filter(is_table, below))


def inside(folder: Path, name: str) -> Path:
    """Return a file of a folder.

    Raises:
        UserError: The file lies outside of the folder, or is not there.
    """
    path = folder / name
    if not path.resolve().is_relative_to(folder.resolve()):
        raise UserError(f"{path} lies outside of {folder}; name a file in it.")
    if not path.is_file():
        files = shown(sorted(p.name for p in folder.iterdir() if p.is_file())) or "no file"
        raise UserError(f"{folder} holds no {name}; there is {files}.")
    return path


def frame_places(folder: Path, named: str = AUTO) -> tuple[Path, ...]:
    """Return the folders in which frames are looked for: all, the usual ones first, or the named.

    Raises:
        UserError: The named one is no folder.
    """
    if named != AUTO:
        if not (folder / named).is_dir():
            raise UserError(f"{folder / named} is no folder; name another with --param frames.")
        return (folder / named,)
    hidden = (".", "__")
    below = sorted(p for p in folder.iterdir() if p.is_dir() and not p.name.startswith(hidden))
    usual = [folder / name for name in FRAME_FOLDERS if folder / name in below]
    return (folder, *usual, *(path for path in below if path not in usual))


def read_frames(folder: Path, options: ImportOptions) -> Recording:
    """Read the table of a folder and its labels, find the frames and check every file.

    Raises:
        UserError: The table, a frame, a label or a column is missing or wrong; the sentence names
            it.
    """
    path = table_path(folder, options.table)
    data = read_file(path)
    table = read_table(path, data)
    if (video := find_video(folder)) is not None:
        frames, bristol, column = video_frames(video), False, options.column
        names = video_names(table, column, frames)
        places: tuple[Path, ...] = (frames,)
    else:
        column = table.column(options.column) if options.column else table.column(*NAMES)
        bristol = path.name in TARGETS and column in NAME_COLUMNS
        names = frame_names(path, map(str, table.cells[column]))
        places = frame_places(folder, options.frames)
        if bristol and options.frames == AUTO:  # raw pictures beside its own are no frames
            places = (*[p for p in places if p.name in FRAME_FOLDERS][:1], folder)
    files, frames = _find_frames(path, folder, names, places, options)
    rows = [row for row, file in enumerate(files) if file is not None]
    paths = tuple(file for file in files if file is not None)
    rest = None if video is not None else _find_rest(frames, set(paths), lettered=bristol)
    columns = [name for name in table.columns if _LABEL.fullmatch(name)] if bristol else None
    facts = read_labels(table, names, rows, options, name=column, columns=columns)
    kind, bits, sha256, hashes = check_frames(data, paths, rest)
    refuse_frozen(path, np.array(hashes), rows, facts)
    about, notes = _read_about(folder)
    notes += facts.pop("notes")
    if rest is not None and rest.stem == "image_0":
        notes.append(f"{rest.name}, which no row lists, is taken for the frame at rest.")
    if bits > 8:
        notes.append(f"frames have up to {bits} bits a pixel; they become 8.")
    there = [name for name in CONTACT_COLUMNS if name in table.columns]
    lacking = [name for name in CONTACT_COLUMNS if name not in facts["labels"]]
    if there and lacking and options.indenter == AUTO:
        missing = f"{', '.join(lacking)} is missing or holds no numbers"
        notes.append(f"{path.name} has {', '.join(there)}, but no contacts: {missing}.")
    if left_out := len(names) - len(rows):
        notes.append(f"rows of {path.name} left out, no file: {left_out:,}.")
    recording = Recording(
        format="bristol" if bristol else "csv",
        generation=f"{path.name}, {column}",
        folder=folder,
        table=path,
        paths=paths,
        frames=frames,
        stored=kind,
        bits=bits,
        rest=rest,
        sha256=sha256,
        about=about,
        notes=tuple(notes),
        **facts,
    )
    return prepare_frames(recording, options.light)


def table_path(folder: Path, name: str, channels: Path | None = None) -> Path:
    """Return the table of the labels.

    Args:
        folder: The recording.
        name: Its name, where it is known.
        channels: File of the channels, which holds the labels, too, where no other table is there.

    Raises:
        UserError: There is no table, or there are several of which none is named.
    """
    if name:
        return inside(folder, name)
    if channels is None and (targets := find_targets(folder)):
        return targets
    paths = [p for p in find_tables(folder) if p != channels] or [*filter(None, [channels])]
    if not paths:
        raise UserError(
            f"{folder} holds no dataset.json, {TARGETS[0]} or other table; put a CSV file with a "
            "row a frame there and `tactibench data import` it, or name another folder."
        )
    if len(paths) > 1:
        names = shown([path.relative_to(folder).as_posix() for path in paths])
        raise UserError(
            f"{folder} holds several tables ({names}); name those of labels and channels with "
            "--param table=FILE --param channels=FILE, or try `tactibench data import --guess`."
        )
    return paths[0]


def _read_about(folder: Path) -> tuple[dict[str, Any], list[str]]:
    """Return the content of files that say how frames were taken, and notes on damaged ones."""
    about, notes = {}, []
    for file in sorted(file for pattern in _ABOUT for file in folder.glob(pattern)):
        try:
            about[file.name] = read_json(file)
        except UserError as error:
            notes.append(f"left out: {error}")
    return about, notes


def frame_name(cell: str) -> str:
    """Return the name of a frame with '/' as separator, "" for none.

    A name from another machine counts from its last part that leads up, or from its root.
    """
    text = re.sub(r"^[A-Za-z]:", "", cell.strip().replace("\\", "/").replace("\0", ""))
    name = PurePosixPath(re.sub(r"^(.*/)?\.\./", "", text).lstrip("/"))
    return "" if name == PurePosixPath() else str(name)


def frame_names(path: Path, cells: Iterable[str]) -> tuple[str, ...]:
    """Return the names of frames with '/' as separator, in the order of the table.

    Raises:
        UserError: A name is empty.
    """
    names = tuple(map(frame_name, cells))
    if "" in names:
        raise UserError(f"{path} row {names.index('') + 1} names no frame; each needs a file name.")
    return names


def _find_frames(
    table: Path, folder: Path, names: Sequence[str], places: Sequence[Path], options: ImportOptions
) -> tuple[list[Path | None], Path]:
    """Return the file of every name, and the folder from which names count.

    A file is None where it is missing and the options skip its row.
    """
    found = [find_frame(folder, places, name) for name in names]
    absent = [name for name, hits in zip(names, found, strict=True) if not hits]
    if absent and (options.missing == REFUSE or len(absent) == len(names)):
        more = f" (and {len(absent) - 1:,} more)" if len(absent) > 1 else ""
        where = shown([str(places[0]), *(p.name for p in places[1:])], 4)
        what = f"the frame {absent[0]}{more}, which is not in {where}"
        raise UserError(f"{table} names {what}; add it or drop its row.")
    files = [next(iter(hits.values()), None) for hits in found]
    usual = {folder, *(folder / name for name in FRAME_FOLDERS)}
    used = dict.fromkeys(p for hits in found for p in ([*hits][:1] if usual & {*hits} else hits))
    present = [name for name, hits in zip(names, found, strict=True) if hits]
    sides = {part.lower() for name in present for part in PurePosixPath(name).parts[:-1]}
    if len(used) > 1 or {"left", "right"} <= sides:
        where = ", ".join(place.name for place in used) if len(used) > 1 else "left, right"
        raise UserError(
            f"{table} names frames that are in {where}, maybe of different sensors; say which with "
            "--param frames=FOLDER (and missing=skip for rows without a frame)."
        )
    listed: dict[Path, int] = {}
    for row, file in enumerate(files, start=1):
        if file is not None and (first := listed.setdefault(file, row)) != row:
            same = f"rows {first} and {row} both name the frame {file.name}"
            raise UserError(f"{table} {same}; remove one.")
    return files, next(iter(used))


def find_frame(folder: Path, places: Sequence[Path], name: str) -> dict[Path, Path]:
    """Return place -> file of a frame, found by as many last parts of its name as fit.

    A folder of the recording in a name is never left out: right/0.png is not in left.

    Args:
        folder: The recording.
        places: Folders in which frames are looked for.
        name: The frame's name, which may be absolute or from another machine.
    """
    parts = PurePosixPath(name).parts
    ends = ("",) if name.lower().endswith(PICTURES) else ("", *PICTURES)  # a name may lack its end
    for start in range(len(parts)):
        above = folder / parts[start - 1] if start else None
        free = [p for p in places if above is None or p == above or not above.is_dir()]
        last = "/".join(parts[start:])
        tried = {(place, end): place / f"{last}{end}" for end in ends for place in free}
        if hits := {place: file for (place, _), file in tried.items() if file.is_file()}:
            return hits
    return {}


def find_video(folder: Path) -> Path | None:
    """Return the only video of a folder that holds no pictures."""
    videos = [path for path in folder.iterdir() if is_picture(path, VIDEOS)]
    return videos[0] if len(videos) == 1 and not any(map(is_picture, folder.rglob("*"))) else None


def video_names(table: Table, column: str, frames: Path) -> tuple[str, ...]:
    """Return the files of a video's frames, which the rows name by numbers from 0 or 1."""
    count = sum(is_picture(path) for path in frames.iterdir())
    numbers = np.arange(len(table), dtype=np.float64)
    if column:
        numbers = table.numbers(table.column(column))
        numbers = numbers - (numbers.min() >= 1 and numbers.max() == count)
    if (not column and len(table) != count) or not np.isin(numbers, np.arange(count)).all():
        raise UserError(
            f"{table.path} has {len(table):,} rows, and the video {count:,} frames; name a column "
            "with the numbers of its frames, from 0, with --param column=COLUMN."
        )
    return tuple(f"{int(number)}.png" for number in numbers)


def _find_rest(folder: Path, listed: set[Path], *, lettered: bool) -> Path | None:
    """Return the unlisted frame that is called init, rest or the like.

    Newer Bristol recordings count frames from 1, and image_0 shows the sensor at rest.
    """
    paths = sorted(path for path in folder.iterdir() if is_picture(path) and path not in listed)
    first = [path for path in paths if lettered and path.name == "image_0.png"]
    return next(iter([*filter(is_rest_name, paths), *first]), None)


def refuse_frozen(
    table: Path, signals: npt.NDArray[Any], rows: Sequence[int], facts: Mapping[str, Any]
) -> None:
    """Refuse signals that stand still while presses change: the camera or the log hung.

    Args:
        table: The file of the labels, for errors.
        signals: (N,) or (N, C) what must differ from row to row.
        rows: Rows of the table.
        facts: Fields of a recording that come from its labels.
    """
    if len(rows) <= _FROZEN:
        return
    same = (signals[1:] == signals[:-1]).reshape(len(rows) - 1, -1).all(axis=1)
    scenes = facts["scenes"]
    touching = np.array([s is None or not s.pose.depth <= 0 for s in scenes])
    changes = np.array([one != two for one, two in pairwise(scenes)], dtype=bool)
    if not any(scenes) and (poses := place_keys(None, facts["labels"])) is not None:
        changes = (poses[1:] != poses[:-1]).any(axis=1)
    frozen = same & changes & touching[1:]
    runs = np.convolve(frozen, np.ones(_FROZEN)) >= _FROZEN
    if runs.any():
        row = rows[int(np.argmax(runs)) + 1] + 1
        raise UserError(
            f"{table} row {row}: the signal is that of the {_FROZEN} rows before while the presses "
            f"change ({frozen.sum():,} such rows); the sensor stood still there, remove the rows."
        )


def read_labels(
    table: Table,
    names: Sequence[str],
    rows: Sequence[int],
    options: ImportOptions,
    *,
    name: str = "",
    columns: Sequence[str] | None = None,
    others: Collection[str] = (),
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
        others: Columns that are no labels, such as channels.

    Raises:
        UserError: A column is missing, a cell is no number, or labels describe no scene that can
            be.
    """
    flags = table.select(options.sites)
    others = {*others, *table.signals} - {*flags}
    if options.labels != AUTO:
        columns = table.select(options.labels)
    elif columns is None:
        no_labels = {name, options.press, options.join, *others, *flags}
        may_be = (column for column in table.columns if column not in no_labels)
        columns = [column for column in may_be if table.numeric_share(column) >= _MOSTLY_NUMBERS]
    indenter = options.indenter
    if indenter == AUTO:
        indenter = SINGLE if {*CONTACT_COLUMNS} <= {*columns} else NONE
    needed, empty = tip_columns(options, indenter)  # read even where cells are no numbers
    columns = tuple(dict.fromkeys([*columns, *(c for c in table.columns if c in needed)]))
    places = needed & {*table.columns} if indenter == SINGLE else set()
    resting = table.blank(places)
    empty |= places if resting.any() else set()
    labels = {column: table.numbers(column, allow_empty=column in empty) for column in columns}
    for column in places:
        if np.isnan(labels[column][~resting]).any():
            table.numbers(column)
    roles = role_columns(options, indenter, labels, table.path)
    at_rest = {column: np.where(resting, 0.0, labels[column]) for column in places}
    scenes = scenes_of(labels | at_rest, roles, options, indenter, table.path)
    if scenes is not None and resting.any():
        touching = zip(scenes, resting, strict=True)
        scenes = tuple(replace(s, pose=Pose(depth=0.0)) if rests else s for s, rests in touching)
    presses, note = read_presses(table, names, options, place_keys(scenes, labels))
    array = options.sites in table.arrays  # its columns have no names of their own
    sites = tuple(ascii_uppercase[: len(flags)]) if array else flags
    labels |= {site: table.numbers(column) for site, column in zip(sites, flags, strict=True)}
    forces: Sequence[Forces | None] = [None] * len(names)
    if scenes is not None and "force" in roles:
        newtons = signed_column(labels, roles["force"])
        forces = normal_forces(scenes, newtons, options.surface_radius_mm)
    return {
        "names": tuple(names[row] for row in rows),
        "labels": {column: values[rows] for column, values in labels.items()},
        "scenes": tuple(None if scenes is None else scenes[row] for row in rows),
        "presses": tuple(presses[row] for row in rows),
        "forces": tuple(forces[row] for row in rows),
        "sites": sites,
        "columns": {"name": name, **roles} if name else roles,
        "extra": {
            column: tuple(map(str, table.cells[column].iloc[list(rows)]))
            for column in table.columns
            if column not in {*columns, *others, *flags, name}
        },
        "dome_radius_mm": None if indenter == NONE else options.surface_radius_mm,
        "notes": table.notes + note,
    }


def place_keys(scenes: Sequence[Scene] | None, labels: Labels) -> FloatArray | None:
    """Return (N, K) numbers that rows of one place share; None where no place is known.

    A place is where tips are, at whatever depth, and the whole pose of a plate or of a robot. Rows
    that touch nothing have no place, and share none; nor do presses that were dragged differently.
    """
    dragged = [labels[name] for name in shear_columns(labels)]
    if scenes is None:
        poses = [values for name, values in labels.items() if name in ALIAS]
        return np.column_stack([*poses, *dragged]) if len(poses) > 1 else None
    tips = max(len(scene.indenter.offsets) for scene in scenes)
    keys = np.full((len(scenes), 3 + 2 * tips), -_NOWHERE)
    for row, scene in enumerate(scenes):
        pose, plate = scene.pose, scene.indenter.is_plate
        keys[row, :3] = pose.tilt, pose.yaw if plate else 0.0, pose.depth if plate else 0.0
        places = tip_positions(scene)[:, :2].ravel()
        keys[row, 3 : 3 + len(places)] = places
        if pose.depth <= 0 and not plate:
            keys[row, 0] = _NOWHERE * (1 + row)
    return np.column_stack([keys, *dragged])


def read_presses(
    table: Table, names: Sequence[str], options: ImportOptions, places: FloatArray | None
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the press of every row, and a note on them.

    Rows that agree in all columns that the options name share a press, and so do rows at one place.
    Texts agree where they are equal, numbers where a robot came back to one place. A press is named
    after its first row.

    Args:
        table: The labels.
        names: Names of the rows.
        options: Names of the columns.
        places: (N, K) keys of the places, see ``place_keys``.
    """
    groups, note = [], ""
    if options.press:
        columns = [table.column(name.strip()) for name in options.press.split(",")]
        cells = (map(str, table.cells[name]) for name in columns)
        names = [" ".join(row) for row in zip(*cells, strict=True)]
        numbers = [
            table.numbers(name)
            if table.numeric_share(name) == 1
            else np.unique(list(table.cells[name]), return_inverse=True)[1]
            for name in columns
        ]
        groups.append(same_places(np.column_stack(numbers)))
    if places is not None:
        place, touching = same_places(places), places[:, 0] < _NOWHERE
        if _extent(places, place) > _LONGEST_PLACE:
            # Rows on a path have neighbours all along it: only equal ones are one place.
            place = np.unique(places, axis=0, return_inverse=True)[1].ravel()
        count, half = len(np.unique(place[touching])), touching.sum() / 2
        if count > half:  # a robot may come back less exactly, if it came back at all
            near = same_places(places, _LONGEST_PLACE)
            fewer = len(np.unique(near[touching]))
            if _FEWEST_PLACES <= fewer <= half and _extent(places, near) <= 2 * _LONGEST_PLACE:
                place, count = near, fewer
        if _FEWEST_PLACES <= count < touching.sum():
            groups.append(place)
            note = f"{count:,} places: rows at one place are one press, which trains or tests."
        elif count < min(_FEWEST_PLACES, touching.sum()):
            note = f"only {count:,} places: rows at one place train and test."
        where = np.where(touching[:, None], places[:, 3:], np.nan)
        run = np.cumsum(~touching | np.append(True, ~touching[:-1]))  # from lift to lift
        lifts = np.sum(np.bincount(run) > 1) >= _FEWEST_RUNS
        if lifts and spacing_in_groups(where, run) <= GATHERED:
            groups.append(run)
            note = "rows between two that touch nothing are near each other: one press."
        elif not (note or groups) and spacing_in_groups(where, np.arange(len(run)) // 2) < _FOLLOWS:
            note = (
                "rows are near the rows before them: if a tip slid, name the column that numbers "
                "the slides with --param press=COLUMN, or frames of one slide train and test."
            )
    first: dict[int, str] = {}
    group = _linked(groups) if groups else np.arange(len(names))
    presses = (first.setdefault(at, name) for at, name in zip(group.tolist(), names, strict=True))
    return tuple(presses), (note,) if note else ()


def spacing_in_groups(places: FloatArray, group: npt.NDArray[np.intp]) -> float:
    """Return how far rows of one group are apart, as a share of what any two rows are: 1 by chance.

    NaN where places never change, or no group has two rows.

    The axis along which they are farthest counts, and the mean over rows or over groups, whichever
    is larger: neither a few long presses nor many short ones decide alone. Distances are in the
    order of the places, so that a parking place is next to the sensor.

    Args:
        places: (N, K) coordinates of all tips, NaN where none is touched.
        group: (N,) groups.
    """

    def gaps(ranks: npt.NDArray[Any], of: npt.NDArray[Any]) -> tuple[npt.NDArray[Any], ...]:
        order = np.lexsort((ranks, of))
        count = np.bincount(of)
        at = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
        sums = np.bincount(of[order], (2 * at + 1 - np.repeat(count, count)) * ranks[order])
        several = count > 1
        return 2 * sums[several] / (count * (count - 1))[several], count[several]

    shares = []
    for values in places.T:
        known = np.isfinite(values)
        ranks = pd.Series(values[known]).rank().to_numpy()
        within, count = gaps(ranks, np.unique(group[known], return_inverse=True)[1])
        any_two = gaps(ranks, np.zeros(len(ranks), dtype=np.intp))[0]
        if len(within) and any_two[0] > 0:
            shares.append(max(within.mean(), np.average(within, weights=count)) / any_two[0])
    return float(max(shares, default=np.nan))


def _linked(groups: Sequence[npt.NDArray[np.int64]]) -> npt.NDArray[np.int64]:
    """Return the (N,) groups of rows that any of several groupings puts together."""
    links = []
    for group in groups:
        _, first, of = np.unique(group, return_index=True, return_inverse=True)
        links.append(np.column_stack([np.arange(len(group)), first[of]]))
    return _components(len(groups[0]), np.concatenate(links))


def _extent(places: FloatArray, place: npt.NDArray[np.int64]) -> float:
    """Return the largest extent of the (N, K) rows of one place."""
    rows = pd.DataFrame(places).groupby(place)
    return float((rows.max() - rows.min()).to_numpy().max())


def same_places(points: FloatArray, apart: float = _SAME_PLACE) -> npt.NDArray[np.int64]:
    """Return the (N,) groups of (N, K) points that are one place along every axis."""
    from scipy.spatial import cKDTree

    places, place_of = np.unique(points, axis=0, return_inverse=True)
    close = cKDTree(places).query_pairs(apart, p=np.inf, output_type="ndarray")
    return _components(len(places), close)[place_of.ravel()]


def _components(count: int, pairs: npt.NDArray[np.intp]) -> npt.NDArray[np.int64]:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)


def check_frames(
    table: bytes, paths: Sequence[Path], rest: Path | None
) -> tuple[ImageKind, int, str, list[int]]:
    """Read every file once.

    Args:
        table: Bytes of the table.
        paths: Files of the frames, at least one.
        rest: File of the undeformed frame.

    Returns:
        Size and colours of every frame, the most bits of a pixel, the sha256 over the table, all
        frames and the rest frame, and a number for every frame that equal files share.

    Raises:
        UserError: A frame cannot be decoded, or differs from the others.
    """
    digest = hashlib.sha256(table)
    first: ImageKind | None = None
    depths: set[int] = set()
    contents = []
    for path in (*paths, *([] if rest is None else [rest])):
        data = read_file(path)
        kind, bits = check_picture(path, data)
        first = first or kind
        depths.add(bits)
        if kind != first or (0 in depths and len(depths) > 1):
            what = f"{kind}{' of 16 bits a pixel' if bits else ''}, but {paths[0].name} is {first}"
            raise UserError(f"{path} is {what}; all frames and the rest frame must be alike.")
        # The length keeps two files from passing for one.
        digest.update(len(data).to_bytes(8, "little"))
        digest.update(data)
        contents.append(zlib.crc32(data))
    assert first is not None, "a table has at least one row"  # noqa: S101
    return first, max(8, *depths), digest.hexdigest(), contents[: len(paths)]
