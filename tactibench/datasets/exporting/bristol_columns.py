"""Columns of a Bristol ``targets.csv``: which label and which part of a scene stands where.

A pose of a scene is that of the indenter in the sensor's frame, with extrinsic rotations about
x, y, z (``sxyz``): a plate turned by ``tilt`` about y and then by ``yaw`` about z touches a dome of
radius R at R sin(tilt) (cos(yaw), sin(yaw)), which is the definition of both. ``pose_z`` is the
depth past first touch, larger is deeper.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from tactibench.datasets import Sample

NAME, OBJECT, PRESS, SESSION = "sensor_image", "object_label", "press", "session"
POSE = ("pose_x", "pose_y", "pose_z", "pose_Rx", "pose_Ry", "pose_Rz")
_NUMBERED = dict(zip((f"pose_{axis}" for axis in "123456"), POSE, strict=True))
"""Names of an older generation of the same convention."""
_AS_POSE = {"x": "pose_x", "y": "pose_y", "depth": "pose_z", "tilt": "pose_Ry", "yaw": "pose_Rz"}
_NOT_TURNED = "pose_Rx"


@dataclass(frozen=True)
class Columns:
    """labels: label -> column. scene: field of a pose -> column. zero: columns that are 0."""

    labels: Mapping[str, str]
    scene: Mapping[str, str]
    zero: tuple[str, ...] = ()

    def order(self) -> list[str]:
        """The header: the frame, the pose, everything else, where the frame belongs."""
        numbers = [*self.scene.values(), *self.zero, *self.labels.values()]
        pose = [name for name in POSE if name in numbers]
        others = [name for name in numbers if name not in POSE]
        return [NAME, *([OBJECT] if self.scene else []), *pose, *others, PRESS, SESSION]


def columns_of(samples: Sequence[Sample]) -> Columns:
    """Labels keep their names, but that ``pose_1`` ... become ``pose_x`` ...; where no label is a
    pose, the scene's pose takes these columns."""
    names = list(dict.fromkeys(name for sample in samples for name in sample.labels))
    scenes = any(sample.scene is not None for sample in samples)
    taken = {NAME, OBJECT, PRESS, SESSION, *(name for name in names if name in POSE)}
    labels = {name: name for name in names if name in POSE}
    for name in (name for name in names if name not in labels):
        alias = _NUMBERED.get(name, name)
        labels[name] = _free(name if alias in taken else alias, taken)
    if not scenes:
        return Columns(labels, {})
    if not taken & set(POSE):
        return Columns(labels, _AS_POSE, (_NOT_TURNED,))
    return Columns(labels, {key: _free(f"scene_{key}", taken) for key in _AS_POSE})


def row_of(sample: Sample, columns: Columns, objects: Mapping[object, int]) -> dict[str, str]:
    """The cells of a sample but for its name; numbers are written so that they read the same.

    objects: indenter -> its label.
    """
    cells = {columns.labels[name]: repr(float(value)) for name, value in sample.labels.items()}
    if sample.scene is not None:
        pose = sample.scene.pose
        cells |= {column: repr(float(getattr(pose, key))) for key, column in columns.scene.items()}
        cells |= dict.fromkeys(columns.zero, repr(0.0))
        cells[OBJECT] = str(objects[sample.scene.indenter])
    return {**cells, PRESS: sample.press, SESSION: sample.session}


def limits(rows: Iterable[Mapping[str, str]]) -> dict[str, list[float]]:
    """``pose_llims`` and ``pose_ulims`` of the convention, where all six columns are full."""
    poses = [[row.get(name, "") for name in POSE] for row in rows]
    if not all(all(pose) for pose in poses):
        return {}
    columns = list(zip(*([float(cell) for cell in pose] for pose in poses), strict=True))
    return {
        "pose_llims": [min(column) for column in columns],
        "pose_ulims": [max(column) for column in columns],
    }


def _free(name: str, taken: set[str]) -> str:
    """The name, lengthened until it is free, and taken from now on."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name
