"""Roles of columns: which of them hold places, depths and forces, and the evidence for it.

A name alone gives no role. Places need a sibling along the other axis and a plausible range, a
second tip needs places and depths of its own, and the sign of a height follows from the signal. A
unit that a name states always holds.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from tactibench.datasets.options import MM_PER, stated_unit, unit_word
from tactibench.datasets.tables import FloatArray, Table, shown
from tactibench.errors import UserError

_AXES = {
    "x": r"x|[cp]x|pos(ition)?x|x(c|pos)",
    "y": r"y|[cp]y|pos(ition)?y|y(c|pos)",
    "depth": r".*depth|indentation|indent|penetration",
    "z": r"z|[cp]z|pos(ition)?z|z(c|pos)|height",
    "force": r"force|load|f[zn]",
    "spacing": r"spacing|separation|gap",
    "yaw": r"yaw|rot(ation)?|orientation|angle|theta",
    "press": r"press(es)?|trial|touch|poke|tap|contact|episode|event|grasp|seq(uence)?|stroke|run"
    r"|cycle|interaction|rep(eat|etition)?|sample",
    "w": r"q?w",
}
"""Words of a role; a column has the first role that one of its words has."""
_USUAL = {
    *("contact", "tip", "probe", "indenter", "press", "position", "pos", "point", "location"),
    *("center", "centre", "coord", "coordinate", "label", "true", "stage", "robot", "tool", "tcp"),
}
"""Words beside an axis that are surely of the place that was pressed."""
_ELSE = {
    *("force", "torque", "moment", "shear", "object", "velocity", "vel", "speed", "acceleration"),
    *("acc", "accel", "gyro", "mag", "angular", "linear", "quat", "quaternion", "orientation"),
    *("rotation", "rot", "error", "err", "std", "var", "target", "cmd", "command", "goal"),
    *("pixel", "pixels", "pred", "predicted", "camera", "cam", "imu", "marker", "pin", "delta"),
    *("noise", "offset", "gripper", "image", "bit", "move", "temp", "temperature", "wrench"),
    *("fx", "fy", "fz", "sigma", "rms", "twist", "normal", "gel", "base", "displacement", "disp"),
    *("flow", "slip", "drag", "strain", "stress", "pressure", "deformation", "voltage", "current"),
}
"""Words beside an axis that name another quantity, or another thing than the tip."""
_NARROWEST_MM, _WIDEST_MM = 3.0, 300.0
"""Spans of the places of a sensor: a finger's pad has 10 mm, a large skin 200 mm."""
_ALIKE = 0.6
"""Least rank correlation of a column with itself in the row whose channels are most alike: .9 and
more for the places of a skin, 0 for what has no part in the signal."""
_FOLLOWS = 0.3
"""Least rank correlation of a height with the strength of the signal, to tell its sign."""
_FEWEST_ROWS = 20
"""Rows from which a correlation of that size is no chance."""
_FEWEST_PRESSES = 10
"""Presses of a recording; a column with fewer names sessions, unless its rows share a place."""
_FAR_MM = 20.0
"""No soft sensor is pressed so deep: such depths are heights of a robot."""
_MOST_TURN = 6.3
"""Largest turn in radians: a full one. Larger numbers are degrees."""
_MOST_NEWTON = 100.0
"""Largest force that a soft sensor bears; larger numbers have another unit."""


@dataclass
class Evidence:
    """What the signal says of columns, and what was found out about them.

    Attributes:
        strength: Returns how far the signal of every row is from the usual one, (N,), NaN where it
            was not looked at.
        alike: Returns the rank correlation of values with those of the rows most alike, None where
            it cannot be told.
        options: Option -> value as text.
        remarks: Option -> the evidence, or what a person should check.
        unused: Column -> the reason why it has no role.
    """

    strength: Callable[[], FloatArray]
    alike: Callable[[FloatArray], float | None]
    options: dict[str, str] = field(default_factory=dict)
    remarks: dict[str, str] = field(default_factory=dict)
    unused: dict[str, str] = field(default_factory=dict)

    def give(self, role: str, value: str, remark: str = "") -> None:
        """Give a role to columns where a person has not."""
        if role not in self.options:
            self.options[role] = value
            self.remarks |= {role: remark} if remark else {}


@dataclass(frozen=True)
class Name:
    """A column's name taken apart: "contactX_1 [mm]" is axis x, number 1, beside it contact."""

    column: str
    axis: str
    number: str
    beside: tuple[str, ...]

    @property
    def is_else(self) -> bool:
        """Whether the words beside the axis name another quantity; single letters do as well."""
        return any(word in _ELSE or len(word) == 1 for word in self.beside)


def words(name: str) -> list[str]:
    """Return the words and numbers in a column's name."""
    parts = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return [word.lower() for word in re.findall(r"[^\W\d_]+|\d+", parts)]


def take_apart(column: str) -> Name:
    """Return the axis that a column's name states, "" for none, and the words beside it."""
    parts = words(re.sub(r"[\[({].*?[\])}]", "", column))
    number = "".join(word for word in parts if word.isdigit())
    parts = [word for word in parts if not word.isdigit()]
    if len(parts) > 1 and unit_word(parts[-1]):
        del parts[-1]
    for axis, pattern in _AXES.items():
        for at, word in enumerate(parts):
            if re.fullmatch(pattern, word):
                return Name(column, axis, number, tuple(parts[:at] + parts[at + 1 :]))
    return Name(column, "", number, tuple(parts))


def find_roles(table: Table, columns: Sequence[str], evidence: Evidence) -> None:
    """Find the roles of columns that may be labels.

    Args:
        table: The labels.
        columns: The columns of numbers that no other role has.
        evidence: The roles that a person gave; it is completed.

    Raises:
        UserError: Several columns could have a role, or a unit cannot be told; the sentence says
            what to write.
    """
    options, remarks, unused = evidence.options, evidence.remarks, evidence.unused
    of_arrays = {c for name in table.arrays for c in table.select(name)}
    names = [
        Name(column, "", "1", tuple(words(column))) if column in of_arrays else take_apart(column)
        for column in columns
        if column not in options.values()
    ]
    for quaternion in _quaternions(table, names):
        unused |= dict.fromkeys(quaternion, "a unit quaternion")
        names = [name for name in names if name.column not in quaternion]
    if "x" not in options and "y" not in options:
        _find_places(table, names, evidence)
    for axis in "xy":
        if axis not in options:
            raise UserError(
                f"{table.path} has no column that is surely {axis}; its columns are "
                f"{shown(table.columns)}. Say which it is with --param {axis}=COLUMN; of a plate, "
                "`tactibench data fit` reads the tilt."
            )
    _find_unit(table, evidence)
    if "depth" not in options:
        _find_depth(table, names, evidence)
    if "force" not in options and options.get("indenter", "single") == "single":
        _find_force(table, names, evidence)
    spacing = [name.column for name in names if name.axis == "spacing" and not name.is_else]
    turned = any(name.axis == "yaw" and not name.is_else for name in names)
    if spacing and options.get("indenter", "dual") == "dual" and (turned or "yaw" in options):
        evidence.give("spacing", spacing[0])
    unused |= dict.fromkeys(spacing, "a pair without a turn? write indenter=dual spacing=COLUMN")
    if "spacing" in options:
        evidence.give("indenter", "dual")
        _find_turn(table, names, evidence)
    evidence.give("indenter", "single")
    _find_zeros(table, evidence)
    remarks.setdefault("x", f"{_span(table, options['x']):.4g} across in the unit of the table")


def _values(table: Table, text: str) -> FloatArray:
    """Return the values of columns in a list, negated where a name begins with '-'."""
    return np.concatenate(
        [
            (-1.0 if name.startswith("-") else 1.0)
            * table.numbers(name.strip().removeprefix("-"), allow_empty=True)
            for name in text.split(",")
        ]
    )


def _span(table: Table, text: str) -> float:
    values = _values(table, text)
    return float(np.nanmax(values) - np.nanmin(values))


def _quaternions(table: Table, names: Sequence[Name]) -> Iterator[set[str]]:
    """Yield the columns x, y, z, w whose squares sum to 1 in all rows: an orientation."""
    by_axis = {axis: [name for name in names if name.axis == axis] for axis in "xyzw"}
    for w in by_axis["w"]:
        for x in by_axis["x"]:
            rest = [
                name.column
                for axis in "yz"
                for name in by_axis[axis]
                if (name.beside, name.number) == (x.beside, x.number)
            ]
            four = [x.column, *rest, w.column]
            norm = sum(np.square(_values(table, column)) for column in four)
            if len(four) == 4 and np.allclose(norm, 1.0, atol=0.02):
                yield set(four)


def _find_places(table: Table, names: Sequence[Name], evidence: Evidence) -> None:
    """Find x and y, of one tip or of several that are numbered and have depths of their own."""
    fit: dict[tuple[str, ...], dict[str, tuple[Name, Name]]] = {}
    for x in names:
        for y in names:
            same = (x.axis, y.axis) == ("x", "y") and (x.beside, x.number) == (y.beside, y.number)
            lengths = all(stated_unit(n.column) in (None, *MM_PER) for n in (x, y))
            if not (same and lengths) or x.is_else:
                continue
            if len(table) < _FEWEST_ROWS or any(_span(table, n.column) for n in (x, y)):
                fit.setdefault(x.beside, {})[x.number] = (x, y)
    if not fit:
        _find_unnamed_places(table, names, evidence)
        return
    unusual = {beside: len({*beside} - _USUAL) for beside in fit}
    best = [beside for beside in fit if unusual[beside] == min(unusual.values())]
    if len(best) > 1:
        pairs = [", ".join(n.column for n in next(iter(fit[beside].values()))) for beside in best]
        raise UserError(
            f"{table.path}: {' or '.join(pairs)} may be the places; say which with --param "
            "x=COLUMN --param y=COLUMN."
        )
    pairs_of = fit[best[0]]
    numbers = sorted(pairs_of, key=lambda number: (len(number), number))
    depths = [
        [n for n in names if n.axis in ("depth", "z") and not n.is_else and n.number == number]
        for number in numbers
    ]
    if len(numbers) > 1 and numbers[0] and all(depths):
        tips = [(*pairs_of[n], each[0]) for n, each in zip(numbers, depths, strict=True)]
        if all(_is_other_tip(table, tips[0][:2], tip[:2]) for tip in tips[1:]):
            evidence.give("indenter", "tips", f"{len(numbers)} tips, each with a depth of its own")
            for role, columns in zip(("x", "y", "depth"), zip(*tips, strict=True), strict=True):
                evidence.give(role, ",".join(name.column for name in columns))
            return
    elif len(numbers) > 1 and numbers[0]:
        pair = " and ".join(n.column for n in pairs_of[numbers[1]])
        raise UserError(
            f"{table.path}: {pair} have no depth of their own, so that they are no second tip for "
            "sure; say what the places are with --param x=COLUMN --param y=COLUMN."
        )
    x_name, y_name = pairs_of[numbers[0]]
    evidence.give("x", x_name.column)
    evidence.give("y", y_name.column)
    for number in numbers[1:]:
        for name in pairs_of[number]:
            evidence.unused[name.column] = "no second tip: its places are not those of one"


def _is_other_tip(table: Table, first: Sequence[Name], other: Sequence[Name]) -> bool:
    """Return whether places lie where those of the first tip do, but not right at them."""
    apart = []
    for one, two in zip(first, other, strict=True):
        a, b = (_values(table, name.column) for name in (one, two))
        wide, span = (np.nanmax(values) - np.nanmin(values) for values in (a, b))
        away = abs(np.nanmedian(a) - np.nanmedian(b))
        if len(a) >= _FEWEST_ROWS and (not wide / 4 <= span <= 4 * wide or away > 2 * wide):
            return False
        apart.append(np.abs(a - b) > 0.1 * wide)
    return bool(np.mean(apart[0] | apart[1]) > 0.5) or len(table) < _FEWEST_ROWS


def _find_unnamed_places(table: Table, names: Sequence[Name], evidence: Evidence) -> None:
    """Take the first two columns without names as x and y where the signal has part in both."""
    may_be = [
        name.column
        for name in names
        if name.number and not name.axis and not {*name.beside} & _ELSE
        if not counts_up(table, name.column) and len(np.unique(_values(table, name.column))) > 2
    ]
    if len(may_be) < 2 or (table.header and not table.arrays):
        return
    x, y = may_be[:2]
    ranks = [evidence.alike(_values(table, column)) or 0.0 for column in (x, y)]
    spans = [_span(table, column) for column in (x, y)]
    if min(ranks) >= _ALIKE and max(spans) <= 10 * min(spans):
        said = "no name says it: the first two columns that rows with a like signal share"
        evidence.give("x", x, f"{said} (rank correlation {ranks[0]:.2f}); check it")
        evidence.give("y", y, f"likewise ({ranks[1]:.2f})")
        for column in may_be[2:]:
            evidence.unused[column] = f"a depth or a force? write depth={column} or force={column}"


def _find_unit(table: Table, evidence: Evidence) -> None:
    """Tell the unit of places from their names, or from their range where only one can be."""
    options = evidence.options
    columns = [name.strip().removeprefix("-") for r in "xy" for name in options[r].split(",")]
    units = {unit for column in columns if (unit := stated_unit(column)) in MM_PER}
    if "unit" in options or all(stated_unit(column) in MM_PER for column in columns):
        return
    if len(units) == 1:
        evidence.give("unit", str(units.pop()), "as the other column of places")
        return
    span = max(_span(table, column) for column in columns)
    if len(table) >= _FEWEST_ROWS and not _NARROWEST_MM <= span <= _WIDEST_MM:
        if not 1e-3 * _NARROWEST_MM <= span <= 1e-3 * _WIDEST_MM:
            raise UserError(
                f"{table.path}: the places span {span:.4g}, which tells no unit; say it with "
                f"--param unit=UNIT, one of {', '.join(MM_PER)}."
            )
        evidence.give("unit", "m", f"places span {span:.4g}; no sensor is so narrow in mm")
    else:
        evidence.remarks.setdefault("x", f"no unit is stated; places span {span:.4g}: taken as mm")


def _find_depth(table: Table, names: Sequence[Name], evidence: Evidence) -> None:
    """Find the depth, of a column that is called so, or of a height whose sign can be told."""
    options, unused = evidence.options, evidence.unused
    place = take_apart(options["x"].removeprefix("-"))
    lengths = [n for n in names if stated_unit(n.column) in (None, *MM_PER) and not n.is_else]
    depths = [name for name in lengths if name.axis == "depth"]
    sibling = ("z", place.beside, place.number)
    heights = [name for name in lengths if (name.axis, name.beside, name.number) == sibling]
    if len(depths) > 1:
        depths = [name for name in depths if name.number == place.number] or depths
        fewest = min(len(name.beside) for name in depths)
        depths = [name for name in depths if len(name.beside) == fewest]
    if len(depths) > 1:
        raise UserError(
            f"{table.path}: {' or '.join(n.column for n in depths)} may be the depth; say which "
            "with --param depth=COLUMN."
        )
    unnamed = [column for column, why in unused.items() if why.startswith("a depth or")]
    column = next((name.column for name in [*depths, *heights]), unnamed[0] if unnamed else "")
    if not column:
        return
    values = _millimetres(table, column, options)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    follows = _correlation(values, evidence.strength())
    said = "" if follows is None else f"the signal follows it (rank correlation {follows:.2f})"
    far = max(abs(low), abs(high)) > _FAR_MM
    if not depths and len(table) >= _FEWEST_ROWS and high - low < 0.3:
        unused[column] = f"a height that changes by {high - low:.2g} mm only: no depth"
        return
    if column in unnamed and not (far and follows and abs(follows) >= _FOLLOWS):
        return
    if not depths and follows is not None and abs(follows) >= _FOLLOWS:
        sign = "-" if follows < 0 else ""
    elif not depths and (far or low < 0 < high):
        unused[column] = f"is deeper up or down? write depth={column} or depth=-{column}"
        return
    else:
        sign = "-" if float(np.nanmedian(values)) < 0 else ""
        said = f"{'negative' if sign else 'larger'} values are taken as deeper; {said}".rstrip("; ")
    unused.pop(column, None)
    evidence.give("depth", f"{sign}{column}", said)


def _millimetres(table: Table, column: str, options: dict[str, str]) -> FloatArray:
    stated = stated_unit(column.removeprefix("-"))
    return (
        _values(table, column) * MM_PER[stated if stated in MM_PER else options.get("unit", "mm")]
    )


def _correlation(first: FloatArray, second: FloatArray) -> float | None:
    """Return the rank correlation over rows that have both, None where there are few."""
    from scipy.stats import spearmanr

    if len(first) != len(second):
        return None
    both = np.isfinite(first) & np.isfinite(second)
    if np.sum(both) < _FEWEST_ROWS or min(np.ptp(first[both]), np.ptp(second[both])) == 0:
        return None
    return float(spearmanr(first[both], second[both]).statistic)


def _find_force(table: Table, names: Sequence[Name], evidence: Evidence) -> None:
    """Find the normal force where one column can be it, and its numbers can be newtons."""
    normal = [
        name
        for name in names
        if name.axis == "force"
        or (name.axis == "z" and {*name.beside} & {"force", "f"})
        or (not name.axis and stated_unit(name.column) == "N")
        if not {*name.beside} & {"target", "cmd", "gripper", "goal", "error", "pred"}
    ]
    for name in normal:
        values = _values(table, name.column)
        sign = "-" if float(np.nanmedian(values)) < 0 else ""
        largest, least = np.nanmax(np.abs(values)), np.nanmin(-values if sign else values)
        if len(normal) > 1 or stated_unit(name.column) not in (None, "N"):
            evidence.unused[name.column] = f"a force? in N, write force={name.column}"
        elif not 0 < largest <= _MOST_NEWTON or least < -0.1 * largest:
            evidence.unused[name.column] = "no normal force in N: its range is none of one"
        else:
            evidence.give("force", f"{sign}{name.column}", f"normal force, up to {largest:.3g} N")


def _find_turn(table: Table, names: Sequence[Name], evidence: Evidence) -> None:
    """Find how a pair is turned, in a unit that is stated or that only degrees can be."""
    turns = [name.column for name in names if name.axis == "yaw" and not name.is_else]
    if turns:
        evidence.give("yaw", turns[0], "at 0 the pair lies along x")
    turn = evidence.options.get("yaw", "0").removeprefix("-")
    if turn in table.cells and "angles" not in evidence.options and stated_unit(turn) is None:
        largest = float(np.nanmax(np.abs(_values(table, turn))))
        if largest <= _MOST_TURN:
            raise UserError(
                f"{table.path}: {turn} reaches {largest:.3g} and states no unit; say it with "
                "--param angles=deg or --param angles=rad."
            )
        evidence.give("angles", "deg", f"{turn} reaches {largest:.4g}, more than a turn in rad")
    heights = [n.column for n in names if n.axis == "z" and n.number and not n.is_else]
    if len(heights) == 2 and all("height" in words(column) for column in heights):
        evidence.give("heights", ",".join(heights))


def _find_zeros(table: Table, evidence: Evidence) -> None:
    """Guess where places and depths are 0, which no table says."""
    options = evidence.options
    for axis in "xy":  # a zero is that of the column as it stands, also where it is negated
        columns = [text.strip().removeprefix("-") for text in options[axis].split(",")]
        if not all(column in table.cells for column in columns):
            continue
        values = np.concatenate([_millimetres(table, column, options) for column in columns])
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        if abs(low + high) > (high - low) / 2:
            said = f"the middle of {low:.4g} to {high:.4g} mm: check it"
            evidence.give(f"{axis}_zero_mm", f"{(low + high) / 2:.6g}", said)
    if "depth" in options:
        columns = options["depth"].split(",")
        values = np.concatenate([_millimetres(table, column, options) for column in columns])
        low = float(np.nanmin(values))
        if low > _FAR_MM or np.nanmax(values) <= 0:
            evidence.give("offset_mm", f"{-low:.6g}", "the shallowest is taken as first touch")


def counts_up(table: Table, column: str) -> bool:
    """Return whether a column grows in every row: a time or a counter."""
    steps = np.diff(table.numbers(column, allow_empty=True))
    return len(steps) >= _FEWEST_ROWS and bool((steps > 0).all())


def find_press(table: Table, columns: Sequence[str], evidence: Evidence) -> None:
    """Find the column whose rows are frames of one press: together in time, or at one place."""
    places = np.zeros((len(table), 2))
    if evidence.options["indenter"] != "tips":
        places = np.column_stack([_values(table, evidence.options[axis]) for axis in "xy"])
    extent = np.maximum(np.ptp(places, axis=0), 1e-12)
    for column in columns:
        taken = "press" in evidence.options or column in evidence.options.values()
        if taken or take_apart(column).axis != "press":
            continue
        cells = np.unique([str(cell) for cell in table.cells[column]], return_inverse=True)[1]
        changes = int((np.diff(cells) != 0).sum()) + 1
        groups = len(set(cells.tolist()))
        spans = [np.ptp(places[cells == group], axis=0) / extent for group in range(groups)]
        wide = float(np.median(np.max(spans, axis=1)))
        if groups in (1, len(cells)) or (changes > groups and wide > 0.1):
            evidence.unused[column] = "its rows are not together, so that it numbers no presses"
        elif groups < _FEWEST_PRESSES and wide > 0.5:
            evidence.unused[column] = "a session: its rows are at places all over the sensor"
        else:
            evidence.give("press", column, "frames of one press train or test, never both")


def is_numeric(table: Table, name: str) -> bool:
    """Return whether nearly all filled cells of a column are numbers.

    Empty cells do not count: a column of tips that seldom press is mostly empty.
    """
    if table.cells[name].dtype.kind in "biuf":
        return True
    filled = sum(cell.strip() not in ("", "nan", "NaN") for cell in table.cells[name])
    return filled > 0 and table.numeric_share(name) * len(table) >= 0.9 * filled


def stem(name: str) -> str:
    """Return what names of a series share: mag of mag_1_x; "" of places and unnumbered names."""
    part = take_apart(name)
    if not part.number or (part.axis and not part.is_else and part.axis != "force"):
        return ""
    first = next((word for word in words(name) if not word.isdigit()), "")
    return re.sub(r"(?<=.)[xyz]$", "", first)
