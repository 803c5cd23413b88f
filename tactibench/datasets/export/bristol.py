"""Export of a data set as a folder of the Bristol tactile stack.

It holds ``sensor_images/``, ``targets*.csv`` and ``*_params.json``. Besides the keys of that stack,
the params name the column of every label and the indenters, so that an import makes the same data
set again.

A pose of a scene is that of the indenter in the sensor's frame, with extrinsic rotations about
x, y, z (``sxyz``): a plate turned by ``tilt`` about y and then by ``yaw`` about z touches a dome of
radius R at R sin(tilt) (cos(yaw), sin(yaw)), which is the definition of both. ``pose_z`` is the
depth past first touch, larger is deeper.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactibench.contacts import Indenter
from tactibench.datasets.dataset import Dataset
from tactibench.datasets.labels import ALIAS
from tactibench.datasets.labels import LETTERED as POSE
from tactibench.datasets.readers.bristol import (
    ATTEMPT,
    COLLECT,
    ENVIRONMENT,
    EXTRA,
    IMAGE_NAME,
    NAME,
    OBJECT,
    PRESS,
    SENSOR,
    SESSION,
    SPLIT_FILE,
    TARGETS,
    TIME,
)
from tactibench.datasets.schema import Sample
from tactibench.datasets.splits import SUBSETS
from tactibench.png import encode_png
from tactibench.records import write_json

IMAGES = "sensor_images"

_POSE_COLUMNS = {
    "x": "pose_x",
    "y": "pose_y",
    "depth": "pose_z",
    "tilt": "pose_Ry",
    "yaw": "pose_Rz",
}
_MOVE_COLUMNS = {"dx": "shear_x", "dy": "shear_y", "dyaw": "shear_Rz"}
"""Columns of the sideways move after first touch."""
_NOT_TURNED = "pose_Rx"


@dataclass(frozen=True)
class Columns:
    """Columns of a table.

    Attributes:
        labels: Label -> column.
        scene: Field of a pose -> column.
        zero: Columns that are 0.
        optional: Columns of facts that only some data sets have.
    """

    labels: Mapping[str, str]
    scene: Mapping[str, str]
    zero: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()

    def order(self) -> list[str]:
        """Return the columns in order: frame, object, pose, numbers, press, session, optional."""
        numbers = [*self.scene.values(), *self.zero, *self.labels.values()]
        pose = [name for name in POSE if name in numbers]
        others = [name for name in numbers if name not in POSE]
        objects = [OBJECT] if self.scene else []
        return [NAME, *objects, *pose, *others, PRESS, SESSION, *self.optional]


def columns_of(samples: Sequence[Sample]) -> Columns:
    """Return the columns of samples.

    Labels keep their names, but ``pose_1`` ... become ``pose_x`` .... Where no label is a pose,
    these columns hold the pose of the scene.
    """
    labels = list(dict.fromkeys(name for sample in samples for name in sample.labels))
    used = {NAME, OBJECT, PRESS, SESSION, ATTEMPT, TIME, EXTRA}
    used |= {name for name in labels if name in POSE}
    columns = {name: name for name in labels if name in POSE}
    for name in (name for name in labels if name not in columns):
        plain = " ".join(name.split()) or "label"  # readers of tables strip names of columns
        alias = ALIAS.get(name, plain)
        columns[name] = _free_name(plain if alias in used else alias, used)
    optional = _optional_columns(samples)
    if not any(sample.scene is not None for sample in samples):
        return Columns(columns, {}, (), optional)
    moves = {}
    if any(sample.scene is not None and sample.scene.pose.moved for sample in samples):
        moves = {field: _free_name(name, used) for field, name in _MOVE_COLUMNS.items()}
    if not used & set(POSE):
        return Columns(columns, {**_POSE_COLUMNS, **moves}, (_NOT_TURNED,), optional)
    scene = {field: _free_name(f"scene_{field}", used) for field in _POSE_COLUMNS}
    return Columns(columns, {**scene, **moves}, (), optional)


def write_bristol(
    dataset: Dataset, folder: Path, samples: Sequence[Sample], advance: Callable[[int], None]
) -> None:
    """Write frames, targets, params and splits.

    Args:
        dataset: The data set.
        folder: An existing, empty folder.
        samples: The samples to write.
        advance: Called with the number of samples that were finished.

    Raises:
        UserError: The samples hold channels, or an image is not the file that was written.
    """
    rest = dataset.rest_image
    images = folder / IMAGES
    images.mkdir()
    rest_name = IMAGE_NAME.format(0)
    if rest is not None:
        (images / rest_name).write_bytes(encode_png(rest))
    columns = columns_of(samples)
    indenters = dict.fromkeys(s.scene.indenter for s in samples if s.scene is not None)
    objects = {indenter: str(number) for number, indenter in enumerate(indenters, start=1)}
    rows = []
    for sample in samples:
        name = IMAGE_NAME.format(sample.id + 1)
        (images / name).write_bytes(dataset.image_file(sample))
        rows.append({NAME: name, **_row(sample, columns, objects)})
        advance(1)
    text = _csv(columns.order(), rows)
    for name in TARGETS:  # poses asked for, poses reached: a data set knows the latter
        (folder / name).write_bytes(text)
    header = dataset.header
    write_json(
        folder / COLLECT,
        {
            **_limits(rows),
            "labels": dict(columns.labels),
            "scene": dict(columns.scene),
            "name": header.name,
            "uuid": header.uuid,
            "source": dict(header.source),
        },
    )
    write_json(
        folder / ENVIRONMENT,
        {
            "units": dict(header.units),
            "axes": header.axes,
            "frames": dict(header.frames),
            "dome_radius_mm": _finite(header.dome_radius_mm, "flat"),
            "objects": {number: _indenter(indenter) for indenter, number in objects.items()},
            "licence": header.licence,
        },
    )
    write_json(
        folder / SENSOR,
        {
            "image": header.image,
            "channels": header.channels,
            "sensor": dict(header.sensor),
            "rest": None if rest is None else rest_name,
        },
    )
    if dataset.splits:
        names = {sample.id: IMAGE_NAME.format(sample.id + 1) for sample in samples}
        splits = {
            name: {
                subset: [names[i] for i in getattr(split, subset) if i in names]
                for subset in SUBSETS
            }
            for name, split in dataset.splits.items()
        }
        write_json(folder / SPLIT_FILE, splits)


def _optional_columns(samples: Sequence[Sample]) -> tuple[str, ...]:
    present = {
        ATTEMPT: any(sample.attempt != 1 for sample in samples),
        TIME: any(sample.t_frame_ns is not None for sample in samples),
        EXTRA: any(sample.extra for sample in samples),
    }
    return tuple(name for name, used in present.items() if used)


def _row(sample: Sample, columns: Columns, objects: Mapping[Indenter, str]) -> dict[str, str]:
    """Return the cells of a sample; numbers are written so that they read the same."""
    cells = {columns.labels[name]: repr(float(value)) for name, value in sample.labels.items()}
    if sample.scene is not None:
        pose = sample.scene.pose
        cells |= {
            column: repr(float(getattr(pose, field))) for field, column in columns.scene.items()
        }
        cells |= dict.fromkeys(columns.zero, repr(0.0))
        cells[OBJECT] = objects[sample.scene.indenter]
    optional = {
        ATTEMPT: str(sample.attempt),
        TIME: "" if sample.t_frame_ns is None else str(sample.t_frame_ns),
        EXTRA: json.dumps(dict(sample.extra), ensure_ascii=False) if sample.extra else "",
    }
    cells |= {PRESS: sample.press, SESSION: sample.session}
    return cells | {name: optional[name] for name in columns.optional}


def _limits(rows: Iterable[Mapping[str, str]]) -> dict[str, list[float]]:
    """Return ``pose_llims`` and ``pose_ulims`` of the convention, where all poses are complete."""
    poses = [[row.get(name, "") for name in POSE] for row in rows]
    if not all(all(pose) for pose in poses):
        return {}
    columns = list(zip(*([float(cell) for cell in pose] for pose in poses), strict=True))
    return {
        "pose_llims": [min(column) for column in columns],
        "pose_ulims": [max(column) for column in columns],
    }


def _csv(header: list[str], rows: list[dict[str, str]]) -> bytes:
    stream = io.StringIO(newline="")
    writer = csv.DictWriter(stream, header, restval="")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue().encode()


def _indenter(indenter: Indenter) -> dict[str, Any]:
    return {
        "name": indenter.name,
        "radius_mm": _finite(indenter.radius, None),
        "offsets_mm": [list(offset) for offset in indenter.offsets],
    }


def _finite(value: float | None, otherwise: str | None) -> float | str | None:
    """Replace infinity, which has no meaning in JSON: a plate has no radius, a pad is "flat"."""
    return otherwise if value is not None and math.isinf(value) else value


def _free_name(name: str, taken: set[str]) -> str:
    """Return the name, lengthened until it is free, and mark it as taken."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name
