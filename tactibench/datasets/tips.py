"""Labels of spherical tips turned into scenes: one tip, a pair, a triangle, or a list."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Indenter, Pose, Scene
from tactibench.datasets.readers.options import DUAL, MM_PER, SINGLE, TIPS, TRIPLE, ImportOptions
from tactibench.errors import UserError
from tactibench.geometry import scene_of_contacts

FloatArray = npt.NDArray[np.float64]

TIP_COUNT = {SINGLE: 1, DUAL: 2, TRIPLE: 3}


def named(text: str) -> list[str]:
    """Return the names in a list with commas, without the '-' of a negated column."""
    return [name.removeprefix("-") for name in texts(text)]


def texts(text: str) -> list[str]:
    """Return the columns or numbers in a list with commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def is_number(text: str) -> bool:
    """Return whether a text is a number for all rows, in place of a column."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def tip_roles(options: ImportOptions, indenter: str) -> dict[str, str]:
    """Return role -> columns or number, for the roles that an indenter needs.

    Raises:
        UserError: A pair or a triangle has no spacing, or lists of columns have wrong lengths.
    """
    roles = {"x": options.x, "y": options.y, "depth": options.depth}
    if indenter == TIPS:
        lengths = {role: len(named(text)) for role, text in roles.items()}
        if len(set(lengths.values())) > 1:
            counts = ", ".join(f"{count} for {role}" for role, count in lengths.items())
            raise UserError(
                f"indenter=tips needs as many columns of x as of y and depth, but got {counts}; "
                "name one of each for every contact, separated by commas."
            )
        return roles
    if indenter in (DUAL, TRIPLE):
        if not options.spacing:
            raise UserError(
                f"indenter={indenter} needs the distance of its tips; name its column, or give a "
                "number, with --param spacing=COLUMN."
            )
        roles |= {"spacing": options.spacing, "yaw": options.yaw}
        if options.heights:
            count = len(named(options.heights))
            if count != TIP_COUNT[indenter]:
                raise UserError(
                    f"heights names {count} columns or numbers, but indenter={indenter} has "
                    f"{TIP_COUNT[indenter]} tips; give one for every tip, separated by commas."
                )
            roles["heights"] = options.heights
    return roles


def named_columns(options: ImportOptions, indenter: str) -> set[str]:
    """Return the columns of the roles of tips; none for other indenters."""
    if indenter not in (*TIP_COUNT, TIPS):
        return set()
    return {name for text in tip_roles(options, indenter).values() for name in named(text)}


def may_be_empty(options: ImportOptions, indenter: str) -> set[str]:
    """Return the columns in which a cell may be empty, because fewer tips pressed."""
    if indenter == TIPS:
        return {name for text in (options.x, options.y, options.depth) for name in named(text)}
    if indenter in (DUAL, TRIPLE):
        texts = (options.spacing, options.yaw, options.heights)
        return {name for text in texts for name in named(text)}
    return set()


def tip_scenes(
    labels: Mapping[str, FloatArray],
    columns: Mapping[str, str],
    options: ImportOptions,
    indenter: str,
    table: Path,
) -> tuple[Scene, ...]:
    """Return the scene of every row.

    A row of a pair or a triangle without a spacing was pressed by one tip; a list of contacts has
    as many as its filled cells. In a list every tip has its own depth; the depth of the other
    indenters belongs to the tip that touches first.

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
    scale = MM_PER[options.unit]

    def column(text: str, factor: float = 1.0) -> FloatArray:
        """Return the (N,) values of a column or of a number, which is in mm or deg already."""
        if is_number(text):
            return np.full(count, float(text))
        sign = -1.0 if text.startswith("-") else 1.0
        return np.asarray(factor * sign * labels[text.removeprefix("-")], dtype=np.float64)

    def place(text: str, zero: float) -> FloatArray:
        return column(text, scale) - (-zero if text.startswith("-") else zero)

    x = np.column_stack([place(text, options.x_zero_mm) for text in texts(columns["x"])])
    y = np.column_stack([place(text, options.y_zero_mm) for text in texts(columns["y"])])
    depth = np.column_stack([column(text, scale) for text in texts(columns["depth"])])
    depth += options.offset_mm
    if indenter == TIPS:
        return tuple(
            _list_scene(*row, options, f"{table} row {number}")
            for number, row in enumerate(zip(x, y, depth, strict=True), 1)
        )
    single = Indenter.single(options.radius_mm)
    poses = np.column_stack([x, y, np.zeros(count), depth])
    if indenter == SINGLE:
        return tuple(Scene(single, Pose(px, py, depth=d)) for px, py, _, d in poses.tolist())
    spacing = column(columns["spacing"], scale)
    turn = np.degrees(1.0) if options.angles == "rad" and not is_number(columns["yaw"]) else 1.0
    yaw = column(columns["yaw"], float(turn))
    heights = np.zeros((count, TIP_COUNT[indenter]))
    if "heights" in columns:
        heights = np.column_stack([column(text, scale) for text in texts(columns["heights"])])
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
