"""From the labels of a robot to what was pressed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Indenter, Pose, Scene
from tactibench.datasets.importing.options import AUTO, ImportOptions
from tactibench.datasets.importing.recording import Recording
from tactibench.errors import UserError

FloatArray = npt.NDArray[np.float64]

PLATE, SINGLE, NONE = "plate", "single", "none"
CONTACT_COLUMNS = ("x_mm", "y_mm", "depth_mm")
NUMBERED = tuple(f"pose_{axis}" for axis in "123456")
LETTERED = ("pose_x", "pose_y", "pose_z", "pose_Rx", "pose_Ry", "pose_Rz")
ALIAS = dict(zip(NUMBERED + LETTERED, LETTERED + NUMBERED, strict=True))


def indentation(
    depth: npt.ArrayLike, tilt: npt.ArrayLike, offset_mm: float, pivot_mm: float
) -> FloatArray:
    """(N,) z + a + p (1 - cos t), mm: how deep a plate is in the dome, along its normal.

    A robot turns the sensor by t (deg) about a point p away from the dome's centre, which lifts the
    centre by p (1 - cos t); a is the travel between label 0 and first touch.
    """
    turned = np.radians(np.asarray(tilt, dtype=np.float64))
    found: FloatArray = np.asarray(depth, dtype=np.float64) + offset_mm
    return found + pivot_mm * (1 - np.cos(turned))


def scenes_of(
    labels: Mapping[str, FloatArray],
    columns: Mapping[str, str],
    options: ImportOptions,
    indenter: str,
) -> tuple[Scene, ...] | None:
    """What was pressed in every frame; None where the labels stay labels.

    columns: roles (depth, tilt, x, y) -> columns of ``labels``. indenter: "plate", "single" or
    "none".
    """
    signs = {role: -1.0 if column.startswith("-") else 1.0 for role, column in columns.items()}
    values = {
        role: signs[role] * labels[column.removeprefix("-")] for role, column in columns.items()
    }
    if indenter == PLATE:
        depth = indentation(values["depth"], values["tilt"], options.offset_mm, options.pivot_mm)
        return tuple(
            Scene(Indenter.plate(), Pose(yaw=options.yaw_deg, tilt=t, depth=d))
            for t, d in zip(values["tilt"].tolist(), depth.tolist(), strict=True)
        )
    if indenter == SINGLE:
        tip = Indenter.single(options.radius_mm)
        rows = zip(values["x"], values["y"], values["depth"] + options.offset_mm, strict=True)
        return tuple(Scene(tip, Pose(float(x), float(y), depth=float(d))) for x, y, d in rows)
    return None


def plate_scenes(
    recording: Recording, options: ImportOptions
) -> tuple[tuple[Scene, ...], dict[str, str]]:
    """The labels of a recording read as a plate's, and role -> column. Raises UserError."""
    labels = {
        name: values for name, values in recording.labels.items() if not np.isnan(values).any()
    }
    roles = roles_of(options, PLATE, labels, recording.table)
    return scenes_of(labels, roles, options, PLATE) or (), roles


def indenter_of(options: ImportOptions, columns: Sequence[str]) -> str:
    """The indenter that "auto" stands for."""
    if options.indenter != AUTO:
        return options.indenter
    return SINGLE if set(CONTACT_COLUMNS) <= set(columns) else NONE


def roles_of(
    options: ImportOptions, indenter: str, labels: Mapping[str, FloatArray], path: Path
) -> dict[str, str]:
    """Role -> column, as far as the indenter needs it.

    path: of the table. pose_x ... pose_Rz are the same columns as pose_1 ... pose_6. Raises
    UserError for a column that is not there, and for a depth that never changes while other lengths
    do: it is the wrong column.
    """
    if indenter == NONE:
        return {}
    plate = indenter == PLATE
    depth = options.depth
    if depth == AUTO:
        depth = "pose_2" if plate else "depth_mm"
    asked = {"depth": depth}
    if plate:
        asked["tilt"] = "pose_6" if options.tilt == AUTO else options.tilt
    else:
        asked |= {"x": options.x, "y": options.y}
    roles = {role: _found(column, tuple(labels), path) for role, column in asked.items()}
    lengths = [name for name in (*NUMBERED[:3], *LETTERED[:3]) if name in labels]
    varying = [name for name in lengths if np.ptp(labels[name]) > 0]
    depth = roles["depth"].removeprefix("-")
    if plate and varying and depth in lengths and depth not in varying:
        raise UserError(
            f"{path}: the depth column {depth} has the same value in every row, while "
            f"{', '.join(varying)} changes; name the right one with the parameter depth=COLUMN."
        )
    return roles


def _found(column: str, columns: Sequence[str], path: Path) -> str:
    sign = "-" if column.startswith("-") else ""
    names = [column.removeprefix("-")]
    names += [ALIAS[name] for name in names if name in ALIAS]
    for name in names:
        if name in columns:
            return f"{sign}{name}"
    raise UserError(
        f"{path} has no column {' or '.join(names)} of numbers; its columns are "
        f"{', '.join(columns) or 'none'}."
    )
