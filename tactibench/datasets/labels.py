"""Labels of a robot turned into contacts: units, the options of an import, and the scenes.

A plate has a depth and a tilt; spherical tips are one, a pair, a triangle, or a list of contacts.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Indenter, Pose, Scene, Workspace
from tactibench.datasets.schema import Forces
from tactibench.errors import UserError, did_you_mean
from tactibench.geometry import DOME_RADIUS_MM, scene_of_contacts, tip_depths, tip_positions
from tactibench.plugins import Parameter

FloatArray = npt.NDArray[np.float64]
Labels = Mapping[str, FloatArray]
"""Column -> (N,) values."""

FRAME_FOLDERS = ("frames_bw", "images", "sensor_images", "processed_images")
AUTO = "auto"
PLATE, SINGLE, DUAL, TRIPLE, TIPS, NONE = "plate", "single", "dual", "triple", "tips", "none"
"""Indenters behind labels: a plate, one spherical tip, two or three of them on a holder, a list of
contacts, or none that is known."""
MM_PER = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 0.001, "in": 25.4}
"""Unit of the columns of lengths -> mm."""
DEG_PER = {"deg": 1.0, "rad": math.degrees(1.0)}
"""Unit of the columns of angles -> degrees."""
_UNIT_WORDS = {
    "mm": "mm millimetre millimeter millimetres millimeters \u6beb\u7c73",
    "cm": "cm centimetre centimeter centimetres centimeters \u5398\u7c73",
    "m": "m metre meter metres meters \u7c73",
    "um": "um \u03bcm micron microns micrometre micrometer \u5fae\u7c73",
    "in": 'in inch inches " zoll',
    "deg": "deg degree degrees \u00b0 grad \u5ea6",
    "rad": "rad radian radians",
    "N": "n newton newtons",
    "px": "px pixel pixels",
    "s": "s sec second seconds",
    "other": "ms us ns v mv hz kpa pa ut mn nm mil mils thou step steps counts pulses",
}
UNITS = {word: unit for unit, words in _UNIT_WORDS.items() for word in words.split()}
"""Words for units -> the unit, in three languages; the two Unicode signs of micro count as one."""
_REMARKS = r"[\[({].*?[\])}]"
"""Parts of a column's name in brackets: a unit, a remark, or both."""
AS_IS, EVEN = "as_is", "even"
"""Ways to read frames: as they are, or as raw pictures of which pins are cut out and evenly lit."""
REFUSE, SKIP = "refuse", "skip"
"""Ways to treat a row whose frame is no file."""

_MM = {"low": -1000.0, "high": 1000.0}


_WORD = r"[^\W\d_]+|\u00b0"


def unit_word(text: str) -> str | None:
    """Return the unit that a word is, None where it is none."""
    return UNITS.get(unicodedata.normalize("NFKC", text).strip().lower())


def stated_unit(column: str) -> str | None:
    """Return the unit that a column's name states, as in ``x [mm]`` or ``tip_x_mm (filtered)``.

    In brackets it is the first word or the last one, beside what else they remark: (in mm, tool).
    """
    outside = re.findall(_WORD, re.sub(_REMARKS, " ", column))[1:]
    # A letter inside of a name is no unit, and "in" is one where it stands alone.
    found = [unit_word(word) for word in outside[-1:]]
    found += [u for w in outside if len(w) > 1 and w.lower() != "in" and (u := unit_word(w))]
    for text in re.findall(_REMARKS, column)[::-1]:
        words = re.findall(_WORD, text)
        words = [word for word in words if len(words) == 1 or word.lower() != "in"]
        units = [unit_word(text[1:-1]), *(unit_word(word) for word in [*words[:1], *words[-1:]])]
        scaled = re.fullmatch(r".[\sx*\u00d7]*[\d.,e+-]*\d\s*(\S+?)\s*.", text)  # [0.1mm]
        if (scaled and unit_word(scaled[1])) or (re.search(r"[/^*\u00b7]", text) and any(units)):
            return "other"  # also [m/s]
        found += [] if re.search(r"\d", text) else units
    return next(filter(None, found), None)


def unit_factor(column: str, per: Mapping[str, float], unit: str) -> float:
    """Return the factor from a column's unit to mm or deg.

    Args:
        column: Its name; a unit that it states holds.
        per: ``MM_PER`` or ``DEG_PER``.
        unit: The unit of columns that state none.
    """
    return per.get(stated_unit(column) or unit, per[unit])


def _option(default: Any, text: str, **limits: Any) -> Any:
    return field(default=default, metadata={"help": text, "limits": limits})


@dataclass(frozen=True)
class ImportOptions:
    """Options of an import, each with its help.

    Columns are named as in the table. A depth column with a '-' in front counts the other way.
    With indenter "none" labels stay labels; "auto" means spherical tips where the table has x_mm,
    y_mm and depth_mm, and "none" otherwise.
    """

    name: str = _option("", "of the data set; default: the source's folder")
    table: str = _option("", "the table in the folder; default: targets.csv, or the only table")
    frames: str = _option(AUTO, "folder of the frames; auto: a usual one, or the table's own")
    light: str = _option(
        AUTO,
        "frames: as_is; even: raw pictures, of which the pins are cut out and evenly lit; auto: "
        "what shows more of a regular set of pins",
        choices=(AUTO, AS_IS, EVEN),
    )
    column: str = _option("", "column that names the frames; default: the first known one")
    labels: str = _option(AUTO, "label columns, by commas; auto: all numbers, of Bristol's its own")
    press: str = _option("", "columns that frames of one press share; default: a frame, a press")
    sites: str = _option("", "columns, or an array, of 1 where a named place is touched, else 0")
    channels: str = _option("", "file of the channels, maybe of the labels; day*.mat are sessions")
    channel_columns: str = _option(
        "", "columns of the channels: names, arrays, FIRST:LAST or ch*; default: all, largest array"
    )
    before: str = _option("", "channels before every press, to subtract: columns, array or file")
    join: str = _option("", "column of a time that labels and channels share; default: the row")
    channels_time: str = _option("", "that column in the file of channels, if its name differs")
    tolerance_ms: float = _option(10.0, "of joined rows, at most", low=0.0, high=60_000.0)
    missing: str = _option(REFUSE, "rows whose frame is no file", choices=(REFUSE, SKIP))
    indenter: str = _option(
        AUTO, "what pressed", choices=(AUTO, NONE, PLATE, SINGLE, DUAL, TRIPLE, TIPS)
    )
    radius_mm: float = _option(3.0, "of every spherical tip", low=0.01, high=1000.0)
    dome_radius_mm: float = _option(DOME_RADIUS_MM, "of the sensor", low=0.1, high=10_000.0)
    surface: str = _option("dome", "shape of the sensor", choices=("dome", "flat"))
    unit: str = _option("mm", "of lengths whose column states none", choices=tuple(MM_PER))
    angles: str = _option("deg", "of angles whose column states none", choices=tuple(DEG_PER))
    x: str = _option("x_mm", "column of x; of every tip, by commas (-COLUMN: the other way)")
    y: str = _option("y_mm", "column of y, likewise")
    x_zero_mm: float = _option(0.0, "x of the sensor's middle in that column", **_MM)
    y_zero_mm: float = _option(0.0, "y of the sensor's middle in that column", **_MM)
    depth: str = _option(AUTO, "column of the depth; auto: pose_2 of a plate, depth_mm of a tip")
    force: str = _option("", "column of the normal force of a tip, N; 0: it touches nothing")
    spacing: str = _option("", "column, or mm: distance of two or three tips; empty cell: one tip")
    yaw: str = _option("0", "column, or deg for all: turn of a holder; at 0 a pair lies along x")
    heights: str = _option("", "columns, or mm: how much further each tip reaches; default: equal")
    tilt: str = _option(AUTO, "column of the plate's tilt; auto: pose_6")
    offset_mm: float = _option(0.0, "added to the depth: its value at first touch, negated", **_MM)
    pivot_mm: float = _option(0.0, "p of depth + offset + p (1 - cos tilt) + q sin tilt", **_MM)
    pivot_side_mm: float = _option(0.0, "q of that indentation", **_MM)
    yaw_deg: float = _option(0.0, "to which a tilted plate's contact moves", low=-360.0, high=360.0)
    sensor: str = _option("", "name of the recorded sensor, as boards show it; default: the folder")
    licence: str = _option("", "of the frames, an SPDX name such as CC-BY-4.0")

    @property
    def surface_radius_mm(self) -> float:
        """Radius of the pressed surface, inf where it is flat."""
        return math.inf if self.surface == "flat" else self.dome_radius_mm

    def changed(self) -> dict[str, Any]:
        """Return the options that differ from their defaults."""
        defaults = asdict(ImportOptions())
        return {name: value for name, value in asdict(self).items() if value != defaults[name]}


PARAMETERS = tuple(
    Parameter(o.name, asdict(ImportOptions())[o.name], o.metadata["help"], **o.metadata["limits"])
    for o in fields(ImportOptions)
)


def read_options(texts: Iterable[str]) -> ImportOptions:
    """Return the options of texts such as ``("indenter=plate", "offset_mm=5")``.

    Raises:
        UserError: A text is no NAME=VALUE, a name is unknown or repeated, or a value is not
            allowed.
    """
    by_name: Mapping[str, Parameter] = {parameter.name: parameter for parameter in PARAMETERS}
    values: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise UserError(f"--param {text!r} is no NAME=VALUE, such as indenter=plate.")
        if name not in by_name:
            raise UserError(f"there is no parameter {name!r}; {did_you_mean(name, by_name)}")
        if name in values:
            raise UserError(f"--param {name} is given twice; give it once.")
        values[name] = by_name[name].parse(value)
    return ImportOptions(**values)


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


def shear_columns(labels: Labels, pattern: re.Pattern[str] = _SHEAR) -> tuple[str, ...]:
    """Return the columns that say how a press was dragged along, where they change."""
    return tuple(n for n, v in labels.items() if pattern.fullmatch(n) and np.ptp(v) > 0)


def signed_column(
    labels: Labels, column: str, per: Mapping[str, float] | None = None, unit: str = ""
) -> FloatArray:
    """Return the values of a column in mm or deg, negated where its name begins with '-'.

    A number in place of a column holds for all rows, and is in mm or deg already.

    Args:
        labels: Column -> (N,) values as they stand in the table.
        column: Name of the column, or a number.
        per: ``MM_PER`` or ``DEG_PER``; None: the values are no lengths and no angles.
        unit: Unit of columns that state none.
    """
    if is_number(column):
        return np.full(len(next(iter(labels.values()))), float(column))
    name = column.removeprefix("-")
    factor = 1.0 if per is None else unit_factor(name, per, unit)
    return np.asarray((-factor if name != column else factor) * labels[name], dtype=np.float64)


def scenes_of(
    labels: Labels, columns: Mapping[str, str], options: ImportOptions, indenter: str, table: Path
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
    tilt = signed_column(labels, columns["tilt"], DEG_PER, options.angles)
    depth = indentation(
        signed_column(labels, columns["depth"], MM_PER, options.unit),
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
    touching = [scene for scene in tips if not tip_depths(scene, radius).max() <= 0]
    reach = max(float(np.abs(tip_positions(scene)[:, :2]).max()) for scene in touching)
    return Workspace(reach, float(depths.min()), float(depths.max()), radius)


def role_columns(
    options: ImportOptions, indenter: str, labels: Labels, table: Path
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
        depth = "depth_mm" if options.depth == AUTO else options.depth
        found = {r: texts(t) for r, t in tip_roles(replace(options, depth=depth), indenter).items()}
        if options.depth == AUTO and "depth_mm" not in columns and indenter != TIPS:
            del found["depth"]
        return {
            role: ",".join(n if is_number(n) else _find_column(n, columns, table) for n in names)
            for role, names in found.items()
        }
    depth = "pose_2" if options.depth == AUTO else options.depth
    tilt = "pose_6" if options.tilt == AUTO else options.tilt
    wanted = (("depth", depth), ("tilt", tilt))
    roles = {role: _find_column(name, columns, table) for role, name in wanted}
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
    hint = did_you_mean(names[0], columns)
    raise UserError(f"{table} has no column {names[0]!r} of numbers; {hint}")


def named(text: str) -> list[str]:
    """Return the names in a list with commas, without the '-' of a negated column."""
    return [name.removeprefix("-") for name in texts(text)]


def given_columns(given: Mapping[str, str]) -> list[str]:
    """Return the columns of labels that options name; "" where x, y or depth names none.

    Args:
        given: Option -> its value as text; spacing, yaw and heights may be numbers.
    """
    places, held = ("x", "y", "depth"), ("spacing", "yaw", "heights")
    roles = [role for role in (*places, "force", "tilt", "press", "join", *held) if role in given]
    names = [(r, name) for r in roles for name in named(given[r]) or [""] * (r in places)]
    return [name for role, name in names if role not in held or not is_number(name)]


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
    labels: Labels, columns: Mapping[str, str], options: ImportOptions, indenter: str, table: Path
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

    def lengths(role: str, zero: float = 0.0) -> FloatArray:
        return np.column_stack(
            [
                signed_column(labels, text, MM_PER, options.unit)
                - (-zero if text.startswith("-") else zero)
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
    spacing = lengths("spacing")[:, 0]
    yaw = signed_column(labels, columns["yaw"], DEG_PER, options.angles)
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
        raise UserError(f"{where}: contact {partly[0] + 1} lacks x, y or depth; fill all or none.")
    filled = cells[~empty.any(axis=1)]
    if not len(filled):
        raise UserError(f"{where} holds no contact; remove the row or fill it.")
    try:
        return scene_of_contacts(
            filled[:, :2], filled[:, 2], options.radius_mm, options.surface_radius_mm
        )
    except ValueError as error:
        raise UserError(f"{where}: {error}; correct x and y or their zeros.") from None
