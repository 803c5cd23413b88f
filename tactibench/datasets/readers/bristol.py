"""Recordings in the convention of the Bristol tactile stack: targets.csv and a folder of frames.

Generations differ in the column that names the frames (image_name; sensor_image), in the labels
(pose_1 ... pose_6; pose_x ... pose_Rz, with shear_* and object_*), in the folder of the frames and
in the files that say how they were taken (meta.json; *_params.json). Names may have backslashes.

The params of a folder that tactibench exported also name the column of every label and the
indenters, so that an import makes the same data set again.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from tactibench.contacts import Indenter, Pose, Scene
from tactibench.datasets.readers.folder import FolderContent, FrameLabels
from tactibench.datasets.readers.options import AUTO, FRAME_FOLDERS, ImportOptions
from tactibench.datasets.readers.table import Table, read_table
from tactibench.datasets.splits import SUBSETS, Split
from tactibench.errors import UserError
from tactibench.png import read_file
from tactibench.protocols import first_mistake

TARGETS = ("targets.csv", "targets_images.csv")
NAME_COLUMNS = ("image_name", "sensor_image")
ABOUT = ("meta.json", "*_params.json")
COLLECT, ENVIRONMENT, SENSOR = (
    f"{name}_params.json" for name in ("collect", "env", "sensor_image")
)
SPLIT_FILE = "splits.json"

NAME, OBJECT, PRESS, SESSION = "sensor_image", "object_label", "press", "session"
ATTEMPT, TIME, EXTRA = "attempt", "t_frame_ns", "extra"
"""Columns of a folder that tactibench exported, beside its labels and poses."""
IMAGE_NAME = "image_{}.png"
"""Name of an exported image by its sample's id plus 1: 0 is the sensor at rest."""

_LABEL = re.compile(r"(pose|move|shear|object)_([1-6]|[xyz]|R[xyz])")
_IMAGE_ID = re.compile(r"image_(\d+)\.png")


_P = TypeVar("_P", bound=BaseModel)


class CollectParams(BaseModel):
    """Content of an export's collect_params.json: which column is which label and pose."""

    name: str
    labels: dict[str, str]
    scene: dict[Literal["x", "y", "depth", "tilt", "yaw", "dx", "dy", "dyaw"], str]


class IndenterParams(BaseModel):
    """An indenter in env_params.json; a plate has no radius."""

    name: str
    radius_mm: float | None
    offsets_mm: tuple[tuple[float, float, float], ...]


class EnvironmentParams(BaseModel):
    """Content of an export's env_params.json: units, dome and indenters."""

    units: dict[str, str]
    axes: str
    frames: dict[str, str]
    dome_radius_mm: float | Literal["flat"] | None
    objects: dict[str, IndenterParams]
    licence: str


class SensorParams(BaseModel):
    """Content of an export's sensor_image_params.json."""

    sensor: dict[str, Any] = Field(default_factory=dict)


_SPLITS = TypeAdapter(dict[str, dict[Literal["train", "validation", "test"], list[str]]])


def find_targets(folder: Path) -> Path | None:
    """Return the table of a folder; None if the folder is no Bristol recording."""
    return next((folder / name for name in TARGETS if (folder / name).is_file()), None)


def read_bristol(folder: Path, options: ImportOptions) -> FolderContent:
    """Read the table of a folder and the files that say how its frames were taken.

    Raises:
        UserError: A file or a column is missing, or cannot be read.
    """
    path = folder / options.table if options.table else find_targets(folder)
    if path is None or not path.is_file():
        raise UserError(f"{folder} holds no {options.table or TARGETS[0]}; name another folder.")
    data = read_file(path)
    table = read_table(path, data)
    name = table.column(options.column) if options.column else table.column(*NAME_COLUMNS)
    frames = _frames_folder(folder, options.frames)
    columns = tuple(column for column in table.columns if _LABEL.fullmatch(column))
    lettered = any(column.partition("_")[2] in ("x", "Rx") for column in columns)
    poses = "pose_x..pose_Rz" if lettered else "pose_1..pose_6"
    files = sorted(file for pattern in ABOUT for file in folder.glob(pattern) if file.is_file())
    about, notes = _read_about(files, needed=OBJECT in table.columns)
    by_options = (options.indenter, options.labels) != (AUTO, AUTO)
    labels = None if by_options or not _is_export(about) else _read_export(folder, table, about)
    return FolderContent(
        format="bristol",
        generation=f"{name}, {poses}, {frames.name}",
        folder=folder,
        table=table,
        data=data,
        name_column=name,
        frame_folders=(frames, folder),  # older tables name frames from the folder above theirs
        label_columns=columns,
        rest_folder=frames,
        splits=_read_splits(folder / SPLIT_FILE, table, name),
        about=about,
        labels=labels,
        notes=notes,
    )


def _frames_folder(folder: Path, name: str) -> Path:
    names = FRAME_FOLDERS if name == AUTO else (name,)
    for candidate in names:
        if (folder / candidate).is_dir():
            return folder / candidate
    if name == AUTO and any(folder.glob("*.png")):  # frames beside the table
        return folder
    raise UserError(f"{folder} holds no folder of frames; looked for {', '.join(names)}.")


def _read_about(files: list[Path], *, needed: bool) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the content of files beside the table, and notes about those that cannot be read.

    Args:
        files: The files.
        needed: Whether the files say what the columns mean, as in a folder that tactibench
            exported. Elsewhere they only describe the recording, which can be read without them.

    Raises:
        UserError: A file that is needed cannot be read.
    """
    about, notes = {}, []
    for file in files:
        try:
            about[file.name] = _read_json(file)
        except UserError as error:
            if needed:
                raise
            notes.append(f"left out: {error}")
    return about, tuple(notes)


def _read_json(path: Path) -> Any:
    def refuse(word: str) -> None:
        raise ValueError(f"it holds {word}, which JSON does not know")

    try:
        return json.loads(read_file(path).decode("utf-8-sig"), parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise UserError(
            f"{path} cannot be read as JSON: {str(error).rstrip('.')}; fix or remove it."
        ) from None


def _is_export(about: Mapping[str, Any]) -> bool:
    """Return whether tactibench exported the folder: other params do not have these keys."""
    collect, environment = about.get(COLLECT), about.get(ENVIRONMENT)
    if not isinstance(collect, dict) or not isinstance(environment, dict):
        return False
    return {"labels", "scene"} <= collect.keys() and "objects" in environment


def _read_splits(path: Path, table: Table, name_column: str) -> dict[str, Split]:
    """Return the splits of an export as row numbers; {} where it has none.

    Raises:
        UserError: The file cannot be read, or names a frame that is in no row.
    """
    if not path.is_file():
        return {}
    try:
        splits = _SPLITS.validate_python(_read_json(path))
    except ValidationError:
        raise UserError(
            f"{path} must hold lists of frames by split and by {', '.join(SUBSETS)}; fix or "
            "remove it."
        ) from None
    row_of = {name: row for row, name in enumerate(table.cells[name_column])}
    rows: dict[str, Split] = {}
    for split, subsets in splits.items():
        unknown = [name for names in subsets.values() for name in names if name not in row_of]
        if unknown:
            raise UserError(
                f"{path}: split {split!r} names {unknown[0]!r}, which is in no row of "
                f"{table.path.name}; fix or remove it."
            )
        ids = {subset: [row_of[name] for name in names] for subset, names in subsets.items()}
        rows[split] = Split.of(**ids)
    return rows


def _read_export(folder: Path, table: Table, about: Mapping[str, Any]) -> FrameLabels:
    """Return the labels and scenes that an export of tactibench states for its samples."""
    collect = _validate(CollectParams, folder / COLLECT, about)
    environment = _validate(EnvironmentParams, folder / ENVIRONMENT, about)
    sensor = _validate(SensorParams, folder / SENSOR, about)
    labels = {
        label: table.numbers(table.column(column), allow_empty=True)
        for label, column in collect.labels.items()
    }
    used = {NAME, OBJECT, PRESS, SESSION, ATTEMPT, TIME, EXTRA}
    used |= {*collect.labels.values(), *collect.scene.values()}
    if "pose_x" in used:
        used.add("pose_Rx")  # a scene is not turned about x, so that its column holds zeros
    radius = environment.dome_radius_mm
    return FrameLabels(
        labels=labels,
        scenes=_read_scenes(folder, table, collect, environment),
        presses=tuple(table.cells[table.column(PRESS)]),
        samples=tuple(_sample_fields(table, row) for row in range(len(table))),
        header={
            "name": collect.name,
            "sensor": sensor.sensor,
            "licence": environment.licence,
            "units": environment.units,
            "axes": environment.axes,
            "frames": environment.frames,
        },
        dome_radius_mm=math.inf if radius == "flat" else radius,
        columns=frozenset(used),
    )


def _validate(schema: type[_P], path: Path, about: Mapping[str, Any]) -> _P:
    try:
        return schema.model_validate(about.get(path.name, {}))
    except ValidationError as error:
        raise UserError(f"{path}: {first_mistake(error, schema)}") from None


def _read_scenes(
    folder: Path, table: Table, collect: CollectParams, environment: EnvironmentParams
) -> tuple[Scene | None, ...]:
    if not collect.scene:
        return (None,) * len(table)
    indenters: dict[str, Indenter] = {}
    for label, params in environment.objects.items():
        radius = math.inf if params.radius_mm is None else params.radius_mm
        try:
            indenters[label] = Indenter(radius, params.offsets_mm, params.name)
        except ValueError as error:
            raise UserError(f"{folder / ENVIRONMENT}: {error}; fix it.") from None
    pose = {
        field: table.numbers(table.column(column), allow_empty=True)
        for field, column in collect.scene.items()
    }
    scenes: list[Scene | None] = []
    for row, label in enumerate(table.cells[table.column(OBJECT)]):
        if not label:
            scenes.append(None)
            continue
        if label not in indenters:
            raise UserError(
                f"{table.path} row {row + 1}: {OBJECT} is {label!r}, which is no indenter of "
                f"{ENVIRONMENT}; fix it."
            )
        values = {field: float(numbers[row]) for field, numbers in pose.items()}
        empty = [collect.scene[field] for field, value in values.items() if np.isnan(value)]
        if empty:
            raise UserError(f"{table.path} row {row + 1}: {empty[0]} is empty; write a number.")
        scenes.append(Scene(indenters[label], Pose(**values)))
    return tuple(scenes)


def _sample_fields(table: Table, row: int) -> dict[str, Any]:
    """Return the fields of a row's sample that are neither labels nor scene."""
    cells = {name: table.cells[name][row] for name in table.columns}
    try:
        fields = {
            SESSION: cells.get(SESSION, ""),
            ATTEMPT: int(cells.get(ATTEMPT) or 1),
            EXTRA: json.loads(cells.get(EXTRA) or "{}"),
        }
        if cells.get(TIME):
            fields[TIME] = int(cells[TIME])
    except ValueError as error:
        raise UserError(f"{table.path} row {row + 1}: {error}; fix it.") from None
    if match := _IMAGE_ID.fullmatch(cells.get(NAME, "")):
        fields["id"] = int(match[1]) - 1
    return fields
