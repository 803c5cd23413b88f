"""Options of an import: the places of labels and frames, and the geometry behind the labels."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from tactibench.errors import UserError, did_you_mean
from tactibench.geometry import DOME_RADIUS_MM
from tactibench.plugins import Parameter

FRAME_FOLDERS = ("frames_bw", "images", "sensor_images", "processed_images")
AUTO = "auto"
PLATE, SINGLE, DUAL, TRIPLE, TIPS, NONE = "plate", "single", "dual", "triple", "tips", "none"
"""Indenters behind labels: a plate, one spherical tip, two or three of them on a holder, a list of
contacts, or none that is known."""
MM_PER = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 0.001, "in": 25.4}
"""Unit of the columns of lengths -> mm."""
DEG_PER = {"deg": 1.0, "rad": math.degrees(1.0)}
"""Unit of the columns of angles -> degrees."""
UNITS = {
    **dict(zip(MM_PER, MM_PER, strict=True)),
    **dict(zip(DEG_PER, DEG_PER, strict=True)),
    **dict.fromkeys(("millimetre", "millimeter", "millimetres", "millimeters"), "mm"),
    **dict.fromkeys(("centimetre", "centimeter", "centimetres", "centimeters"), "cm"),
    **dict.fromkeys(("metre", "meter", "metres", "meters"), "m"),
    **dict.fromkeys(("\u03bcm", "micron", "microns", "micrometre", "micrometer"), "um"),
    **dict.fromkeys(("inch", "inches", '"'), "in"),
    **dict.fromkeys(("degree", "degrees", "\u00b0"), "deg"),
    **dict.fromkeys(("radian", "radians"), "rad"),
    **dict.fromkeys(("n", "newton", "newtons"), "N"),
    **dict.fromkeys(("px", "pixel", "pixels"), "px"),
    **dict.fromkeys(("s", "sec", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "us", "ns", "v", "mv", "hz", "kpa", "pa", "ut", "mn"), "other"),
}
"""Words for units -> the unit; the two Unicode signs of micro count as one."""
AS_IS, EVEN = "as_is", "even"
"""Ways to read frames: as they are, or as raw pictures of which pins are cut out and evenly lit."""
REFUSE, SKIP = "refuse", "skip"
"""Ways to treat a row whose frame is no file."""

_MM = {"low": -1000.0, "high": 1000.0}


def unit_word(text: str) -> str | None:
    """Return the unit that a word is, None where it is none."""
    return UNITS.get(unicodedata.normalize("NFKC", text).strip().lower())


def stated_unit(column: str) -> str | None:
    """Return the unit that a column's name states, as in ``x [mm]``, ``x (mm)`` or ``tip_x_mm``."""
    bracketed = re.findall(r"[\[({]\s*([^])}]*?)\s*[\])}]", column)
    words = re.findall(r"[^\W\d_]+|\u00b0", column)
    found = (unit_word(word) for word in [*bracketed[::-1], *words[:0:-1][:1]])
    return next(filter(None, found), None)


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
    table: str = _option("", "the table in the folder; default: targets.csv, or the only CSV file")
    frames: str = _option(
        AUTO, "folder of the frames; auto: the first known one, or the table's own"
    )
    light: str = _option(
        AUTO,
        "frames: as_is, or even: raw camera pictures, of which the pins are cut out and evenly "
        "lit; auto: even where that shows more of a regular set of pins",
        choices=(AUTO, AS_IS, EVEN),
    )
    column: str = _option("", "column that names the frames; default: the first known one")
    labels: str = _option(
        AUTO, "label columns, separated by commas; auto: all numbers, of Bristol's its own"
    )
    press: str = _option(
        "", "columns that frames of one press share, by commas; default: every frame is a press"
    )
    sites: str = _option(
        "", "columns, or an array, that say which named places are touched (1) or not (0)"
    )
    channels: str = _option(
        "",
        "file of the channels of a sensor without a camera; it may hold the labels, too; several "
        "files, such as day*.mat, are a session each",
    )
    channel_columns: str = _option(
        "",
        "columns of the channels, by commas: names, arrays, FIRST:LAST or ch*; default: all but "
        "the time, the largest array",
    )
    before: str = _option(
        "", "channels before every press, which are subtracted: columns, an array, or a file"
    )
    join: str = _option(
        "", "column of a time in s that labels and channels share; default: they share their rows"
    )
    channels_time: str = _option("", "that column in the file of the channels, if its name differs")
    tolerance_ms: float = _option(
        10.0, "most that two joined rows may be apart", low=0.0, high=60_000.0
    )
    missing: str = _option(REFUSE, "rows whose frame is no file", choices=(REFUSE, SKIP))
    indenter: str = _option(
        AUTO,
        "what pressed, so that labels become contacts",
        choices=(AUTO, NONE, PLATE, SINGLE, DUAL, TRIPLE, TIPS),
    )
    radius_mm: float = _option(3.0, "of every spherical tip", low=0.01, high=1000.0)
    dome_radius_mm: float = _option(DOME_RADIUS_MM, "of the sensor", low=0.1, high=10_000.0)
    surface: str = _option("dome", "shape of the sensor", choices=("dome", "flat"))
    unit: str = _option("mm", "of all columns of lengths", choices=tuple(MM_PER))
    angles: str = _option("deg", "unit of all columns of angles", choices=("deg", "rad"))
    x: str = _option(
        "x_mm",
        "column of x: of a tip, the middle of a holder, or of every tip, by commas (-COLUMN: "
        "counted the other way)",
    )
    y: str = _option("y_mm", "column of y, likewise")
    x_zero_mm: float = _option(0.0, "x of the sensor's middle in that column", **_MM)
    y_zero_mm: float = _option(0.0, "y of the sensor's middle in that column", **_MM)
    depth: str = _option(
        AUTO,
        "column of the depth; auto: pose_2 of a plate, depth_mm of a tip, not known without it",
    )
    force: str = _option(
        "", "column of the normal force of a tip, N, where it was measured; 0: it touches nothing"
    )
    spacing: str = _option(
        "", "column, or mm for all: distance of two tips, side of a triangle; empty cell: one tip"
    )
    yaw: str = _option("0", "column, or deg for all: turn of a holder; at 0 a pair lies along x")
    heights: str = _option(
        "", "columns, or mm for all, by commas: how much further each tip reaches; default: equal"
    )
    tilt: str = _option(AUTO, "column of the plate's tilt; auto: pose_6")
    offset_mm: float = _option(
        0.0, "added to the depth column: its value at first touch, negated", **_MM
    )
    pivot_mm: float = _option(
        0.0, "p of indentation = depth + offset + p (1 - cos tilt) + q sin tilt", **_MM
    )
    pivot_side_mm: float = _option(0.0, "q of that indentation", **_MM)
    yaw_deg: float = _option(
        0.0,
        "direction in the image in which the contact of a tilted plate moves",
        low=-360.0,
        high=360.0,
    )
    sensor: str = _option("unknown", "name of the sensor that was recorded")
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
    Parameter(
        option.name,
        getattr(ImportOptions(), option.name),
        option.metadata["help"],
        **option.metadata["limits"],
    )
    for option in fields(ImportOptions)
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
            raise UserError(
                f"--param {text!r} is not understood; write NAME=VALUE, for example "
                "--param indenter=plate."
            )
        if name not in by_name:
            raise UserError(f"there is no parameter {name!r}; {did_you_mean(name, by_name)}")
        if name in values:
            raise UserError(f"--param {name} is given twice; give it once.")
        values[name] = by_name[name].parse(value)
    return ImportOptions(**values)
