"""Labels of a robot turned into contacts: the meaning of columns, and the scenes they describe."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Indenter, Pose, Scene, Workspace
from tactibench.datasets.readers.options import AUTO, MM_PER, NONE, PLATE, SINGLE, ImportOptions
from tactibench.datasets.readers.recording import Recording
from tactibench.datasets.tips import is_number, tip_roles, tip_scenes
from tactibench.errors import UserError
from tactibench.geometry import DOME_RADIUS_MM, tip_depths, tip_positions

FloatArray = npt.NDArray[np.float64]

CONTACT_COLUMNS = ("x_mm", "y_mm", "depth_mm")
NUMBERED = tuple(f"pose_{axis}" for axis in "123456")
LETTERED = ("pose_x", "pose_y", "pose_z", "pose_Rx", "pose_Ry", "pose_Rz")
ALIAS = dict(zip(NUMBERED + LETTERED, LETTERED + NUMBERED, strict=True))
"""Names of the same column in the two generations of the Bristol convention."""


def indentation(
    depth: npt.ArrayLike,
    tilt: npt.ArrayLike,
    offset_mm: float,
    pivot_mm: float,
    side_mm: float = 0.0,
) -> FloatArray:
    """Return how far a plate came from first touch: z + a + p (1 - cos t) + q sin t.

    A robot turns the sensor about a point p away from the dome's centre, which lifts the centre by
    p (1 - cos t), and by q sin t where that point lies q beside the axis. a is the travel between
    label 0 and first touch. This is the indentation of all data sets: the robot's own travel. The
    holder of a dome gives way under load; a simulated sensor takes that into account by itself.

    Args:
        depth: (N,) depth labels z, mm.
        tilt: (N,) tilt labels t, deg.
        offset_mm: Offset a.
        pivot_mm: Pivot p along the axis.
        side_mm: Pivot q beside the axis.

    Returns:
        (N,) mm.
    """
    turned = np.radians(np.asarray(tilt, dtype=np.float64))
    lowered: FloatArray = np.asarray(depth, dtype=np.float64) + offset_mm
    return lowered + pivot_mm * (1 - np.cos(turned)) + side_mm * np.sin(turned)


def signed_column(labels: Mapping[str, FloatArray], column: str) -> FloatArray:
    """Return the values of a column, negated where its name begins with '-'."""
    sign = -1.0 if column.startswith("-") else 1.0
    return np.asarray(sign * labels[column.removeprefix("-")], dtype=np.float64)


def scenes_of(
    labels: Mapping[str, FloatArray],
    columns: Mapping[str, str],
    options: ImportOptions,
    indenter: str,
    table: Path,
) -> tuple[Scene, ...] | None:
    """Return the scene of every frame; None where the labels describe no scene.

    Args:
        labels: Column -> (N,) values.
        columns: Role (depth, tilt, x, y, spacing, ...) -> column, columns or number.
        options: Geometry behind the labels.
        indenter: "none", "plate", or one of tips.
        table: The file of the labels, for errors.

    Raises:
        UserError: The labels of a tip are incomplete, or describe a contact that cannot be, see
            ``tip_scenes``.
    """
    if indenter == NONE:
        return None
    if indenter != PLATE:
        return tip_scenes(labels, columns, options, indenter, table)
    tilt = signed_column(labels, columns["tilt"])
    if options.angles == "rad":
        tilt = np.degrees(tilt)
    depth = indentation(
        MM_PER[options.unit] * signed_column(labels, columns["depth"]),
        tilt,
        options.offset_mm,
        options.pivot_mm,
        options.pivot_side_mm,
    )
    return tuple(
        Scene(Indenter.plate(), Pose(yaw=options.yaw_deg, tilt=t, depth=d))
        for t, d in zip(tilt.tolist(), depth.tolist(), strict=True)
    )


def own_workspace(
    scenes: Sequence[Scene], dome_radius_mm: float | None, *, always: bool = False
) -> Workspace | None:
    """Return the range of the recorded presses by tips where it replaces the published one.

    It does where the sensor is flat, because the published range is that of a dome; otherwise the
    result is None. A tip at depth 0 or above it touches nothing and belongs to no range.

    Args:
        scenes: The recorded scenes.
        dome_radius_mm: Radius of the pressed surface, inf where it is flat; None: the usual dome.
        always: Whether a dome has its own range as well.
    """
    radius = DOME_RADIUS_MM if dome_radius_mm is None else dome_radius_mm
    tips = [scene for scene in scenes if not scene.indenter.is_plate]
    depths = np.concatenate([np.empty(0), *(tip_depths(scene, radius) for scene in tips)])
    depths = depths[depths > 0]
    if not (always or math.isinf(radius)) or not len(depths):
        return None
    reach = max(float(np.abs(tip_positions(scene)[:, :2]).max()) for scene in tips)
    return Workspace(reach, float(depths.min()), float(depths.max()), radius)


def plate_scenes(
    recording: Recording, options: ImportOptions
) -> tuple[tuple[Scene, ...], dict[str, str]]:
    """Read the labels of a recording as those of a plate.

    Returns:
        The scene of every frame, and role -> column.

    Raises:
        UserError: A column is missing, or the depth column never changes.
    """
    labels = recording.complete_labels()
    columns = role_columns(options, PLATE, labels, recording.table)
    return scenes_of(labels, columns, options, PLATE, recording.table) or (), columns


def choose_indenter(options: ImportOptions, columns: Sequence[str]) -> str:
    """Return the indenter that the option "auto" stands for."""
    if options.indenter != AUTO:
        return options.indenter
    return SINGLE if set(CONTACT_COLUMNS) <= set(columns) else NONE


def role_columns(
    options: ImportOptions, indenter: str, labels: Mapping[str, FloatArray], table: Path
) -> dict[str, str]:
    """Return role -> column, for the roles that the indenter needs.

    pose_x ... pose_Rz are the same columns as pose_1 ... pose_6.

    Args:
        options: Names of the columns.
        indenter: "none", "plate", or one of tips.
        labels: Column -> (N,) values.
        table: The file of the labels, for errors.

    Raises:
        UserError: A column is missing, or the depth never changes while other lengths do: it is
            the wrong column.
    """
    if indenter == NONE:
        return {}
    plate = indenter == PLATE
    depth = options.depth
    if depth == AUTO:
        depth = "pose_2" if plate else "depth_mm"
    if not plate:
        wanted = tip_roles(replace(options, depth=depth), indenter)
        return {role: _find_columns(text, tuple(labels), table) for role, text in wanted.items()}
    wanted = {"depth": depth, "tilt": "pose_6" if options.tilt == AUTO else options.tilt}
    roles = {role: _find_column(column, tuple(labels), table) for role, column in wanted.items()}
    lengths = [name for name in (*NUMBERED[:3], *LETTERED[:3]) if name in labels]
    changing = [name for name in lengths if np.ptp(labels[name]) > 0]
    depth = roles["depth"].removeprefix("-")
    if changing and depth in lengths and depth not in changing:
        raise UserError(
            f"{table}: the depth column {depth} has the same value in every row, while "
            f"{', '.join(changing)} changes; name the right one with the parameter depth=COLUMN."
        )
    return roles


def _find_columns(text: str, columns: Sequence[str], table: Path) -> str:
    """Return a list of columns, separated by commas, as the table names them; numbers stay."""
    return ",".join(
        name if is_number(name) else _find_column(name, columns, table)
        for name in (part.strip() for part in text.split(","))
    )


def _find_column(column: str, columns: Sequence[str], table: Path) -> str:
    sign = "-" if column.startswith("-") else ""
    names = [column.removeprefix("-")]
    names += [ALIAS[name] for name in names if name in ALIAS]
    for name in names:
        if name in columns:
            return f"{sign}{name}"
    raise UserError(
        f"{table} has no column {' or '.join(names)} of numbers; its columns are "
        f"{', '.join(columns) or 'none'}."
    )
