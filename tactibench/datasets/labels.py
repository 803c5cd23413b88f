"""Labels of a robot turned into contacts: the meaning of columns, and the scenes they describe.

A plate has a depth and a tilt; spherical tips are one, a pair, a triangle, or a list of contacts.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Indenter, Pose, Scene, Workspace
from tactibench.datasets.options import (
    AUTO,
    DUAL,
    MM_PER,
    NONE,
    PLATE,
    SINGLE,
    TIPS,
    TRIPLE,
    ImportOptions,
)
from tactibench.datasets.schema import Forces
from tactibench.errors import UserError
from tactibench.geometry import DOME_RADIUS_MM, scene_of_contacts, tip_depths, tip_positions

FloatArray = npt.NDArray[np.float64]

CONTACT_COLUMNS = ("x_mm", "y_mm", "depth_mm")
NUMBERED = tuple(f"pose_{axis}" for axis in "123456")
LETTERED = ("pose_x", "pose_y", "pose_z", "pose_Rx", "pose_Ry", "pose_Rz")
ALIAS = dict(zip(NUMBERED + LETTERED, LETTERED + NUMBERED, strict=True))
"""Names of the same column in the two generations of the Bristol convention."""
_SHEAR = re.compile(r"(move|shear)_([1-6]|[xyz]|R[xyz])")
TIP_COUNT = {SINGLE: 1, DUAL: 2, TRIPLE: 3}


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


def shear_columns(
    labels: Mapping[str, FloatArray], pattern: re.Pattern[str] = _SHEAR
) -> tuple[str, ...]:
    """Return the columns that say how a press was dragged along, where they change."""
    return tuple(n for n, v in labels.items() if pattern.fullmatch(n) and np.ptp(v) > 0)


def signed_column(labels: Mapping[str, FloatArray], column: str, factor: float = 1.0) -> FloatArray:
    """Return the values of a column in mm or deg, negated where its name begins with '-'.

    A number in place of a column holds for all rows, and is in mm or deg already.
    """
    if is_number(column):
        return np.full(len(next(iter(labels.values()))), float(column))
    sign = -factor if column.startswith("-") else factor
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
    scale, turn = _scales(options)
    tilt = signed_column(labels, columns["tilt"], turn)
    depth = indentation(
        signed_column(labels, columns["depth"], scale),
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
    depths = depths[~(depths <= 0)]  # those that are not known, NaN, stay
    if not (always or math.isinf(radius)) or not len(depths):
        return None
    reach = max(float(np.abs(tip_positions(scene)[:, :2]).max()) for scene in tips)
    return Workspace(reach, float(depths.min()), float(depths.max()), radius)


def _scales(options: ImportOptions) -> tuple[float, float]:
    """Return factors from the units of a table's lengths and angles to mm and deg."""
    return MM_PER[options.unit], math.degrees(1.0) if options.angles == "rad" else 1.0


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
            the wrong column. A tip's depth may be missing where no column of it was named: it is
            not known.
    """
    if indenter == NONE:
        return {}
    columns = tuple(labels)
    if indenter != PLATE:
        unknown = options.depth == AUTO and "depth_mm" not in columns and indenter != TIPS
        depth = "depth_mm" if options.depth == AUTO else options.depth
        return {
            role: ",".join(
                name if is_number(name) else _find_column(name, columns, table)
                for name in texts(text)
            )
            for role, text in tip_roles(replace(options, depth=depth), indenter).items()
            if not (unknown and role == "depth")
        }
    depth = "pose_2" if options.depth == AUTO else options.depth
    tilt = "pose_6" if options.tilt == AUTO else options.tilt
    roles = {
        "depth": _find_column(depth, columns, table),
        "tilt": _find_column(tilt, columns, table),
    }
    lengths = [name for name in (*NUMBERED[:3], *LETTERED[:3]) if name in labels]
    changing = [name for name in lengths if np.ptp(labels[name]) > 0]
    depth = roles["depth"].removeprefix("-")
    if changing and depth in lengths and depth not in changing:
        raise UserError(
            f"{table}: the depth column {depth} has the same value in every row, while "
            f"{', '.join(changing)} changes; name the right one with the parameter depth=COLUMN."
        )
    return roles


def _find_column(column: str, columns: Sequence[str], table: Path) -> str:
    """Return a column as the table names it."""
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


def named(text: str) -> list[str]:
    """Return the names in a list with commas, without the '-' of a negated column."""
    return [name.removeprefix("-") for name in texts(text)]


def texts(text: str) -> list[str]:
    """Return the columns or numbers in a list with commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def is_number(text: str) -> bool:
    """Return whether a text is a finite number for all rows, in place of a column."""
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def tip_roles(options: ImportOptions, indenter: str) -> dict[str, str]:
    """Return role -> columns or number, for the roles that an indenter needs.

    Raises:
        UserError: A pair or a triangle has no spacing, or lists of columns have wrong lengths.
    """
    roles = {"x": options.x, "y": options.y, "depth": options.depth}
    if options.force and indenter != SINGLE:
        raise UserError(
            f"force names the force of one tip, but indenter={indenter} has several; leave it out."
        )
    lengths = {role: len(texts(text)) for role, text in roles.items()}
    if set(lengths.values()) != {1} and (indenter != TIPS or len(set(lengths.values())) > 1):
        counts = ", ".join(f"{count} for {role}" for role, count in lengths.items())
        needs = "as many columns of x as of y and depth" if indenter == TIPS else "one column each"
        raise UserError(
            f"indenter={indenter} needs {needs}, but got {counts}; name several, separated by "
            "commas, with indenter=tips alone."
        )
    if options.force:
        roles["force"] = options.force
    if indenter in (DUAL, TRIPLE):
        if not options.spacing:
            raise UserError(
                f"indenter={indenter} needs the distance of its tips; name its column, or give a "
                "number, with --param spacing=COLUMN."
            )
        roles |= {"spacing": options.spacing, "yaw": options.yaw}
        if options.heights:
            count = len(texts(options.heights))
            if count != TIP_COUNT[indenter]:
                raise UserError(
                    f"heights names {count} columns or numbers, but indenter={indenter} has "
                    f"{TIP_COUNT[indenter]} tips; give one for every tip, separated by commas."
                )
            roles["heights"] = options.heights
    return roles


def tip_columns(options: ImportOptions, indenter: str) -> tuple[set[str], set[str]]:
    """Return the columns of the roles of tips, and those of them that may have empty cells.

    A cell is empty where fewer tips pressed. Plates have no such columns.
    """
    if indenter not in (*TIP_COUNT, TIPS):
        return set(), set()
    roles = tip_roles(options, indenter)
    always = () if indenter == TIPS else ("x", "y", "depth", "force")
    columns = {name for text in roles.values() for name in named(text)}
    return columns, columns - {name for role in always for name in named(roles.get(role, ""))}


def tip_scenes(
    labels: Mapping[str, FloatArray],
    columns: Mapping[str, str],
    options: ImportOptions,
    indenter: str,
    table: Path,
) -> tuple[Scene, ...]:
    """Return the scene of every row.

    A row without force touches nothing. A depth that is not known is NaN, but 0 where nothing is
    touched. A row of a pair or a triangle without a spacing was pressed by one tip; a list of
    contacts has as many as its filled cells. In a list every tip has its own depth; the depth of
    the other indenters belongs to the tip that touches first.

    Args:
        labels: Column -> (N,) values.
        columns: Role (depth, x, y, spacing, ...) -> column, columns or number.
        options: Geometry behind the labels.
        indenter: "single", "dual", "triple" or "tips".
        table: The file of the labels, for errors.

    Raises:
        UserError: A cell is empty where its neighbour is not, a spacing is not positive, or a
            contact lies beside the sensor; the sentence names the row.
    """
    count = len(next(iter(labels.values())))
    scale, turn = _scales(options)

    def lengths(role: str, zero: float = 0.0) -> FloatArray:
        return np.column_stack(
            [
                signed_column(labels, text, scale) - (-zero if text.startswith("-") else zero)
                for text in texts(columns[role])
            ]
        )

    x, y = lengths("x", options.x_zero_mm), lengths("y", options.y_zero_mm)
    depth = np.full((count, 1), np.nan)
    if "depth" in columns:
        depth = lengths("depth") + options.offset_mm
    if "force" in columns:
        resting = signed_column(labels, columns["force"]) <= 0
        depth[resting & ~(depth[:, 0] <= 0)] = 0.0
    if indenter == TIPS:
        return tuple(
            _list_scene(*row, options, f"{table} row {number}")
            for number, row in enumerate(zip(x, y, depth, strict=True), 1)
        )
    single = Indenter.single(options.radius_mm)
    poses = np.column_stack([x, y, np.zeros(count), depth])
    if indenter == SINGLE:
        return tuple(Scene(single, Pose(px, py, depth=d)) for px, py, _, d in poses.tolist())
    spacing = signed_column(labels, columns["spacing"], scale)
    yaw = signed_column(labels, columns["yaw"], turn)
    heights = np.zeros((count, TIP_COUNT[indenter]))
    if "heights" in columns:
        heights = lengths("heights")
    scenes = []
    for row in range(count):
        px, py, _, d = poses[row].tolist()
        if np.isnan(spacing[row]):
            scenes.append(Scene(single, Pose(px, py, depth=d)))
            continue
        if np.isnan(yaw[row]) or np.isnan(heights[row]).any():
            missing = "yaw" if np.isnan(yaw[row]) else "a height"
            raise UserError(f"{table} row {row + 1}: {missing} is empty beside a spacing; add it.")
        if not spacing[row] > 0:
            raise UserError(
                f"{table} row {row + 1}: the spacing is {spacing[row]:g} mm, but two tips are "
                "apart; leave the cell empty where one tip pressed."
            )
        indenter_there = _holder(indenter, float(spacing[row]), heights[row], options.radius_mm)
        scenes.append(Scene(indenter_there, Pose(px, py, float(yaw[row]), depth=d)))
    return tuple(scenes)


def normal_forces(
    scenes: Sequence[Scene], force: FloatArray, dome_radius_mm: float
) -> tuple[Forces, ...]:
    """Return the force on the skin of the contact of every scene; () where nothing is touched.

    Args:
        scenes: Presses by one spherical tip.
        force: (N,) normal forces, N; a tip pushes the skin along the line to the dome's centre.
        dome_radius_mm: Radius of the surface, inf where it is flat.
    """
    forces: list[Forces] = []
    for scene, newton in zip(scenes, force.tolist(), strict=True):
        pose, reach = scene.pose, dome_radius_mm + scene.indenter.radius
        x, y = pose.x / reach, pose.y / reach
        z = math.sqrt(max(1.0 - x * x - y * y, 0.0))
        forces.append(() if pose.depth <= 0 else ((-newton * x, -newton * y, -newton * z),))
    return tuple(forces)


def _holder(indenter: str, spacing: float, heights: FloatArray, radius: float) -> Indenter:
    """Return a holder of two tips, or of three on an equilateral triangle."""
    inserts = heights.tolist()
    if indenter == TRIPLE:
        return Indenter.triple((inserts[0], inserts[1], inserts[2]), spacing, radius)
    level = Indenter.dual(spacing, radius)
    offsets = tuple((x, y, h) for (x, y, _), h in zip(level.offsets, inserts, strict=True))
    return Indenter(radius, offsets, level.name)


def _list_scene(
    x: FloatArray, y: FloatArray, depth: FloatArray, options: ImportOptions, where: str
) -> Scene:
    cells = np.column_stack([x, y, depth])
    empty = np.isnan(cells)
    partly = np.flatnonzero(empty.any(axis=1) & ~empty.all(axis=1))
    if len(partly):
        raise UserError(
            f"{where}: contact {partly[0] + 1} lacks its x, y or depth; fill all three or none."
        )
    filled = cells[~empty.any(axis=1)]
    if not len(filled):
        raise UserError(f"{where} holds no contact; remove the row or fill it.")
    try:
        return scene_of_contacts(
            filled[:, :2], filled[:, 2], options.radius_mm, options.surface_radius_mm
        )
    except ValueError as error:
        raise UserError(f"{where}: {error}; correct x and y or their zeros.") from None
