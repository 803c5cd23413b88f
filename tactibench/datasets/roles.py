"""Roles of columns: which of them hold places, depths and forces, and the evidence for it.

A name alone gives no role. Places need a sibling along the other axis and a plausible range, a
second tip needs places and depths of its own, and the sign of a height follows from the signal. A
unit that a name states always holds.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
import numpy.typing as npt

from tactibench.datasets.formats import GATHERED, spacing_in_groups
from tactibench.datasets.labels import MM_PER, named, stated_unit, texts, unit_factor, unit_word
from tactibench.datasets.tables import FloatArray, Table, rank_of_alike, shown, spread_evenly
from tactibench.errors import UserError

_AXES = {
    "x": r"x|[cp]x|pos(ition)?x|x(c|pos)",
    "y": r"y|[cp]y|pos(ition)?y|y(c|pos)",
    "depth": r".*(depth|tiefe)|indentation|indent|penetration|\u6df1\u5ea6|\u538b\u6df1",
    "z": r"z|[cp]z|pos(ition)?z|z(c|pos)|height",
    "force": r"force|load|f[zn]|(normal)?kraft|\u529b|\u538b\u529b",
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
    *("koordinate", "\u5750\u6807", "\u4f4d\u7f6e"),
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
    *("idx", "index"),
}
"""Words beside an axis that name another quantity, or another thing than the tip."""
_NARROWEST_MM, _WIDEST_MM = 3.0, 300.0
"""Spans of the places of a sensor: a finger's pad has 10 mm, a large skin 200 mm."""
_ALIKE = 0.6
"""Least rank correlation of a column with itself in the row whose channels are most alike: .9 and
more for the places of a skin, 0 for what has no part in the signal."""
_FEWEST_ALIKE = 60
"""Fewest rows of which places are compared."""
_LOOKED_AT = 200
"""Most rows of which depths are compared."""
_FOLLOWS = 0.3
"""Least rank correlation of a height with how far signals of like heights are apart, to tell its
sign."""
_FEWEST_ROWS = 20
"""Rows from which a correlation of that size is no chance."""
_LAGS = 10
"""Rows of like heights are a tenth of all apart in their order, so that two are of two presses."""
_FEWEST_PRESSES = 10
"""Presses from which rows that are near each other are no chance."""
_HOVER, _FLAT = 9, 0.05
"""Fewest rows above the sensor from which first touch is told, and the largest change of the signal
that is none, as a share of what the deepest presses change. A press that grows from 0 to a quarter
of its depth changes the signal by .1 and more; the medians of two halves differ by half of that."""
_FEWEST_FELT = 5
"""Fewest presses that a line is laid through."""
_OFF_MM, _OFF_DEPTH_MM = 0.5, 1.5
"""A zero of a height, or of a depth, that is closer to first touch is right: light touches change
no signal."""
_APART = 0.8
"""Largest ``spacing_in_groups`` of a column that is called a press, or whose rows stand together: a
slide across the sensor has .7."""
_TIME = {"t", "time", "timestamp", "stamp", "sec", "secs", "second", "seconds", "date", "datetime"}
"""Words of columns that divide rows by time alone."""
_SHALLOW_MM, _DEEP_MM = 0.1, 30.0
"""Limits of the deepest press of a recording."""
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
        signals: Returns the signals of (n,) rows, (n, F), NaN where they cannot be looked at.
        most: Most rows to look at.
        options: Option -> value as text.
        remarks: Option -> the evidence, or what a person should check.
        unused: Column -> the reason why it has no role.
    """

    signals: Callable[[npt.NDArray[np.intp]], FloatArray]
    most: int
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
    """A column's name taken apart: "contactX_1 [mm]" is axis x, number 1, beside it contact.

    The form is the axis' word without the axis: c of cx, pos of xpos.
    """

    column: str
    axis: str
    number: str
    beside: tuple[str, ...]
    form: str = ""

    @property
    def is_else(self) -> bool:
        """Whether the words beside the axis name another quantity; single letters do as well."""
        return any(word in _ELSE or len(word) == 1 for word in self.beside)


def words(name: str) -> list[str]:
    """Return the words and numbers in a column's name."""
    parts = re.sub(r"([a-z])([A-Z])|([A-Za-z])(?=[\u4e00-\u9fff])", r"\1\3 \2", name)
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
                beside = tuple(parts[:at] + parts[at + 1 :])
                return Name(column, axis, number, beside, word.replace(axis, "", 1))
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
            for name in set(table.columns) - set(columns):
                if (part := take_apart(name)).axis == axis and not part.is_else:
                    table.numbers(name, allow_empty=True)  # its error names the cell
            raise UserError(
                f"{table.path} has no column that is surely {axis}; its columns are "
                f"{shown(table.columns)}. Say which it is with --param {axis}=COLUMN; of a plate, "
                "see `tactibench data fit`."
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
    unused |= dict.fromkeys(spacing, 'may be of a pair without a turn; write indenter = "dual"')
    if "spacing" in options:
        evidence.give("indenter", "dual")
        _find_turn(table, names, evidence)
    evidence.give("indenter", "single")
    _find_zeros(table, evidence)
    remarks.setdefault("x", f"{_span(table, options['x']):.4g} across in the unit of the table")


def _values(table: Table, text: str) -> FloatArray:
    """Return the values of columns in a list, negated where a name begins with '-'."""
    signs = [(-1.0 if name.startswith("-") else 1.0) for name in texts(text)]
    columns = [table.numbers(name, allow_empty=True) for name in named(text)]
    return np.concatenate([sign * column for sign, column in zip(signs, columns, strict=True)])


def _span(table: Table, text: str) -> float:
    return float(np.nanmax(values := _values(table, text)) - np.nanmin(values))


def _quaternions(table: Table, names: Sequence[Name]) -> Iterator[set[str]]:
    """Yield the columns x, y, z, w whose squares sum to 1 in all rows: an orientation."""
    vectors: dict[tuple[object, ...], list[str]] = {}
    for name in names:
        if name.axis in ("x", "y", "z"):
            vectors.setdefault((name.beside, name.number), []).append(name.column)
    for w in (name.column for name in names if name.axis == "w"):
        for three in (vector for vector in vectors.values() if len(vector) == 3):
            squares = [np.square(_values(table, column)) for column in (*three, w)]
            if np.allclose(sum(squares), 1.0, atol=0.02):
                yield {*three, w}


def _find_places(table: Table, names: Sequence[Name], evidence: Evidence) -> None:
    """Find x and y, of one tip or of several that are numbered and have depths of their own."""
    fit: dict[tuple[tuple[str, ...], str], dict[str, tuple[Name, Name]]] = {}
    lengths = [n for n in names if not n.is_else and stated_unit(n.column) in (None, *MM_PER)]
    for x, y in product(lengths, lengths):
        same = (x.beside, x.form, x.number) == (y.beside, y.form, y.number)
        if (
            (x.axis, y.axis) == ("x", "y")
            and same
            and (len(table) < _FEWEST_ROWS or any(_span(table, n.column) for n in (x, y)))
        ):
            fit.setdefault((x.beside, x.form), {})[x.number] = (x, y)
    if not fit:
        _find_unnamed_places(table, names, evidence)
        return
    pairs_in = {key: [n.column for n in next(iter(pairs.values()))] for key, pairs in fit.items()}
    unusual = {
        key: (len({*key[0]} - _USUAL), sum(stated_unit(column) is None for column in columns))
        for key, columns in pairs_in.items()
    }
    best = [key for key in fit if unusual[key] == min(unusual.values())]
    if len(best) > 1:
        either = " or ".join(", ".join(pairs_in[key]) for key in best)
        raise UserError(f"{table.path}: {either} may be the places; say it with --param x=COLUMN.")
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
    for name in pairs_of[numbers[0]]:
        evidence.give(name.axis, name.column)
    for number in numbers[1:]:
        for name in pairs_of[number]:
            evidence.unused[name.column] = "no second tip: its places are not those of one"


def _is_other_tip(table: Table, first: Sequence[Name], other: Sequence[Name]) -> bool:
    """Return whether places lie where those of the first tip do, but not right at them."""
    a, b = (np.array([_values(table, n.column) for n in names]) for names in (first, other))
    wide, span = (np.nanmax(each, axis=1) - np.nanmin(each, axis=1) for each in (a, b))
    away = np.abs(np.nanmedian(a, axis=1) - np.nanmedian(b, axis=1))
    alike = ((wide / 4 <= span) & (span <= 4 * wide) & (away <= 2 * wide.max())).all()
    # A tip may seldom press: rows of both tell.
    apart = (np.abs(a - b) > 0.1 * wide[:, None]).any(axis=0)[np.isfinite(a - b).all(axis=0)]
    return bool(alike and apart.mean() > 0.5) or len(table) < _FEWEST_ROWS


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
    ranks = [_alike(_values(table, column), evidence) for column in (x, y)]
    spans = [_span(table, column) for column in (x, y)]
    if min(ranks) >= _ALIKE and max(spans) <= 10 * min(spans):
        said = "no name says it: the first two columns that rows with a like signal share"
        evidence.give("x", x, f"{said} (rank correlation {ranks[0]:.2f}); check it")
        evidence.give("y", y, f"likewise ({ranks[1]:.2f})")
        for c in may_be[2:]:
            evidence.unused[c] = f'may be a depth or a force; write depth = "{c}" or force = "{c}"'


def _alike(values: FloatArray, evidence: Evidence) -> float:
    """Return ``rank_of_alike`` of values, 0 of few rows or where it cannot be told."""
    rows = spread_evenly(len(values), evidence.most)
    signals, chosen = evidence.signals(rows), values[rows]
    if len(rows) < _FEWEST_ALIKE or np.isnan(chosen).any() or np.isnan(signals).any():
        return 0.0
    return rank_of_alike(signals, chosen) or 0.0


def _find_unit(table: Table, evidence: Evidence) -> None:
    """Tell the unit of places from their names, or from their range where only one can be."""
    options = evidence.options
    columns = [*named(options["x"]), *named(options["y"])]
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
        said = f"no unit is stated; places span {span:.4g}: taken as mm (unit=cm: say so)"
        evidence.remarks.setdefault("x", said)


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
        either = " or ".join(name.column for name in depths)
        raise UserError(f"{table.path}: {either} may be the depth; say which with depth=COLUMN.")
    unnamed = [column for column, why in unused.items() if why.startswith("may be a depth")]
    column = next((name.column for name in [*depths, *heights]), unnamed[0] if unnamed else "")
    if not column:
        return
    values, many = _millimetres(table, column, options), len(table) >= _FEWEST_ROWS
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    follows = _follows(*_look(table, values, evidence))
    said = f"the signal follows it (correlation {follows:.2f})" if follows else ""
    far = max(abs(low), abs(high)) > _FAR_MM
    if not depths and many and high - low < 0.3:
        unused[column] = f"a height that changes by {high - low:.2g} mm only: no depth"
        return
    if column in unnamed and not (far and abs(follows) >= _FOLLOWS):
        return
    sign, crosses = "-" if float(np.nanmedian(values)) < 0 else "", min(-low, high) > _SHALLOW_MM
    if (crosses or not depths) and abs(follows) >= _FOLLOWS:
        sign = "-" if follows < 0 else ""
    elif crosses or (not depths and (far or many)):  # rows may hover, whatever the name
        unused[column] = f'may be the depth; write depth = "{column}" or depth = "-{column}"'
        return
    else:
        said = f"{'negative' if sign else 'larger'} values are taken as deeper; {said}".rstrip("; ")
    deepest = max(-low if sign else high, 0.0)
    if many and depths and not _SHALLOW_MM <= deepest <= _DEEP_MM + max(low, 0):
        raise UserError(
            f"{table.path}: {column} would reach {deepest:.3g} mm, which no press does; write its "
            f"true unit in its name, such as depth [{'m' if deepest < _SHALLOW_MM else 'um'}], or "
            "name another with depth=COLUMN."
        )
    unused.pop(column, None)
    evidence.give("depth", f"{sign}{column}", said)


def _millimetres(table: Table, column: str, options: dict[str, str]) -> FloatArray:
    factor = unit_factor(column.removeprefix("-"), MM_PER, options.get("unit", "mm"))
    return _values(table, column) * factor


def _look(table: Table, values: FloatArray, evidence: Evidence) -> tuple[FloatArray, FloatArray]:
    """Return some of the (N,) values in their order, and the signals of their rows.

    Half of the rows are spread over the order of the values and half over their range, so that it
    does not matter how many of them hover. Rows of one pose are one press.
    """
    columns = [c for axis in "xy" for c in named(evidence.options[axis]) if c in table.cells]
    poses = np.column_stack([values, *(_values(table, column) for column in columns)])
    rows = np.unique(poses, axis=0, return_index=True)[1]
    rows = rows[np.isfinite(values[rows])]  # in the order of the values, which stand first
    if not len(rows):
        return np.empty(0), np.empty((0, 1))
    half = min(evidence.most, _LOOKED_AT) // 2
    even = spread_evenly(len(rows), half)
    levels = np.linspace(values[rows[0]], values[rows[-1]], half)
    rows = rows[np.union1d(even, np.searchsorted(values[rows], levels))]
    signals = evidence.signals(rows)
    seen = np.isfinite(signals).all(axis=1)
    return values[rows[seen]], signals[seen]


def _follows(values: FloatArray, signals: FloatArray) -> float:
    """Return the correlation of the order of values with how far signals of like values are apart.

    Above the sensor signals are alike; the deeper presses are, the more they tell their places.
    """
    if len(values) < _FEWEST_ROWS:
        return 0.0
    lag = len(values) // _LAGS
    apart = np.sqrt(np.square(signals[lag:] - signals[:-lag]).mean(axis=1))
    return float(np.corrcoef(np.arange(len(apart)), apart)[0, 1]) if np.ptp(apart) > 0 else 0.0


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
            evidence.unused[name.column] = f'may be a force, in N: force = "{name.column}"'
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
    touching: npt.NDArray[np.bool_] = np.ones(len(table), dtype=bool)
    if "depth" in options:
        columns = options["depth"].split(",")
        values = np.stack([_millimetres(table, column, options) for column in columns])
        least, first = float(np.nanmin(values)), None
        if len(columns) == 1:
            first = _first_touch(*_look(table, values[0], evidence))
        is_depth = take_apart(columns[0].removeprefix("-")).axis == "depth"
        if first is not None and abs(first) > (_OFF_DEPTH_MM if is_depth else _OFF_MM):
            said = f"first touch, above which the signal does not change, is at {first:.4g} mm"
            evidence.give("offset_mm", f"{-first:.6g}", f"{said}: check it")
        elif first is None and (least > _FAR_MM or np.nanmax(values) <= 0):
            said = "the shallowest is taken as first touch: check it"
            evidence.give("offset_mm", f"{-least:.6g}", said)
        hovers = np.asarray(values + float(options.get("offset_mm", 0)) <= 0).all(axis=0)
        touching = np.asarray(~hovers | hovers.all())
    for axis in "xy":  # a zero is that of the column as it stands, also where it is negated
        columns = named(options[axis])
        if not all(column in table.cells for column in columns):
            continue
        values = np.stack([_millimetres(table, column, options) for column in columns])[:, touching]
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        if abs(low + high) > (high - low) / 2:
            said = f"the middle of {low:.4g} to {high:.4g} mm: check it"
            evidence.give(f"{axis}_zero_mm", f"{(low + high) / 2:.6g}", said)


def _first_touch(depth: FloatArray, signals: FloatArray) -> float | None:
    """Return the depth at first touch, None where no rows hover above the sensor for sure.

    Rows hover where the shallowest quarter of the range of depths, or its shallowest eighth, has
    one signal: there the deeper half of the rows differs from rest as little as the other half.
    Medians say so, which noise does not move.

    Args:
        depth: (N,) depths with any zero, in order, mm.
        signals: (N, F) their signals.
    """
    from scipy.stats import theilslopes

    span = np.ptp(depth) if len(depth) else 0.0
    for share in (1 / 4, 1 / 8):  # an eighth, because robots may start just above the sensor
        count = max(_HOVER, int((depth < depth[:1] + share * span).sum()))
        if count >= len(depth) or depth[count - 1] > depth[0] + span / 2:
            continue
        rest = np.median(signals[:count], axis=0)
        strength = np.sqrt(np.square(signals - rest).mean(axis=1))
        level = np.median(strength[:count])
        flat = _FLAT * (np.median(strength[depth > depth[-1] - span / 4]) - level)
        upper, lower = np.array_split(strength[:count], 2)
        if abs(np.median(lower) - np.median(upper)) > flat / 2:
            continue
        spread = np.quantile(strength[:count], 0.95) - level
        same = np.abs(strength - level) <= max(flat, spread)
        # of each row and the 8 deeper ones
        after = np.convolve(same, np.ones(_HOVER))[_HOVER - 1 :]
        felt = np.flatnonzero(~same & (after < _HOVER / 2))
        if not len(felt):
            continue
        deep = depth[felt[0] :]
        if len(deep) < _FEWEST_FELT:  # too few presses for a line
            return float(deep[0])
        # Light touches hide in the noise: a line through the others tells where the signal began.
        signal = np.sqrt(np.maximum(strength[felt[0] :] ** 2 - level**2, 0.0))
        slope, intercept, *_ = theilslopes(signal, deep)
        began = -intercept / slope if slope > 0 else np.inf
        return float(np.clip(began, depth[0], deep[0]))
    return None


def is_time(column: str) -> bool:
    """Return whether a column's name says a time and nothing else, as ``time [s]`` or ``t_ms``."""
    part = take_apart(column)
    return not part.axis and bool(part.beside) and {*part.beside} <= _TIME


def counts_up(table: Table, column: str) -> bool:
    """Return whether a column grows in every row: a time or a counter."""
    steps = np.diff(table.numbers(column, allow_empty=True))
    return len(steps) >= _FEWEST_ROWS and bool((steps > 0).all())


def find_press(table: Table, columns: Sequence[str], evidence: Evidence) -> None:
    """Find the column whose rows are frames of one press: together in time, or near each other.

    A column that is called otherwise must hold no measurement and no time, and have rows of many
    presses.
    """
    options = evidence.options
    tips = [name for axis in "xy" for name in named(options[axis]) if name in table.cells]
    places = np.array([_values(table, name) for name in tips]).reshape(len(tips), -1).T
    of_press = {column: take_apart(column).axis == "press" for column in columns}
    for column in sorted(columns, key=lambda column: not of_press[column]):
        if "press" in options or column in options.values():
            continue
        group = np.unique(list(map(str, table.cells[column])), return_inverse=True)[1]
        count = np.bincount(group)
        apart = spacing_in_groups(places, group)
        stands = int((np.diff(group) != 0).sum()) + 1 == len(count)
        if of_press[column]:
            if len(count) in (1, len(group)) or not (stands or apart <= _APART):
                evidence.unused[column] = "its rows are not together: it numbers no presses"
            elif apart > _APART:
                evidence.unused[column] = "a session: its rows are at places all over the sensor"
            else:
                evidence.give("press", column, "frames of one press train or test, never both")
        elif (
            np.sum(count > 1) >= _FEWEST_PRESSES
            and len(count) <= len(group) / 2
            and apart <= (_APART if stands else GATHERED)
            and not {*words(column)} & _TIME
            and not (is_numeric(table, column) and (_values(table, column) % 1).any())
        ):
            evidence.give("press", column, "its rows are near each other: one press")


def is_numeric(table: Table, name: str) -> bool:
    """Return whether nearly all filled cells of a column are numbers.

    Empty cells do not count: a column of tips that seldom press is mostly empty.
    """
    if table.cells[name].dtype.kind in "biuf":
        return True
    filled = len(table) - int(table.blank([name]).sum())
    return filled > 0 and table.numeric_share(name) * len(table) >= 0.9 * filled


def stem(name: str) -> str:
    """Return what names of a series share: mag of mag_1_x; "" of places and unnumbered names."""
    part = take_apart(name)
    if not part.number or (part.axis and not part.is_else and part.axis != "force"):
        return ""
    first = next((word for word in words(name) if not word.isdigit()), "")
    return re.sub(r"(?<=.)[xyz]$", "", first)
