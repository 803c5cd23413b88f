"""What an import can be told: where labels and frames are, and the geometry behind the labels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from tactibench.datasets.importing.names import REFUSE, SKIP
from tactibench.errors import UserError, did_you_mean
from tactibench.geometry import DOME_RADIUS_MM
from tactibench.plugins.specs import Parameter

FRAME_FOLDERS = ("frames_bw", "images", "sensor_images", "processed_images")
AUTO = "auto"


@dataclass(frozen=True)
class ImportOptions:
    """Columns are named as in the table; a depth column with a '-' in front counts the other way.

    indenter "none": labels stay labels. "auto": spherical tips where the table has x_mm, y_mm and
    depth_mm, "none" otherwise.
    """

    name: str = ""
    table: str = ""
    frames: str = AUTO
    column: str = ""
    labels: str = AUTO
    press: str = ""
    missing: str = REFUSE
    indenter: str = AUTO
    radius_mm: float = 3.0
    dome_radius_mm: float = DOME_RADIUS_MM
    x: str = "x_mm"
    y: str = "y_mm"
    depth: str = AUTO
    tilt: str = AUTO
    offset_mm: float = 0.0
    pivot_mm: float = 0.0
    yaw_deg: float = 0.0
    sensor: str = "unknown"
    licence: str = ""

    def given(self) -> dict[str, Any]:
        """The options that differ from their defaults."""
        defaults = asdict(_DEFAULTS)
        return {name: value for name, value in asdict(self).items() if value != defaults[name]}


_MM: dict[str, Any] = {"low": -1000.0, "high": 1000.0}
_HELP: dict[str, tuple[str, dict[str, Any]]] = {
    "name": ("of the data set; default: the source's folder", {}),
    "table": ("the table in the folder; default: targets.csv, or the only CSV file", {}),
    "frames": ("folder of the frames; auto: the first known one, or the table's own", {}),
    "column": ("column that names the frames; default: the first known one", {}),
    "labels": ("label columns, separated by commas; auto: all numbers, of Bristol's its own", {}),
    "press": ("column that frames of one press share; default: every frame is a press", {}),
    "missing": ("rows whose frame is no file", {"choices": (REFUSE, SKIP)}),
    "indenter": (
        "what pressed, so that labels become contacts",
        {"choices": (AUTO, "none", "plate", "single")},
    ),
    "radius_mm": ("of the spherical tip", {"low": 0.01, "high": 1000.0}),
    "dome_radius_mm": ("of the sensor", {"low": 0.1, "high": 10_000.0}),
    "x": ("column of the tip's x, mm", {}),
    "y": ("column of the tip's y, mm", {}),
    "depth": ("column of the depth, mm; auto: pose_2 of a plate, depth_mm of a tip", {}),
    "tilt": ("column of the plate's tilt, deg; auto: pose_6", {}),
    "offset_mm": ("added to the depth column: its value at first touch, negated", _MM),
    "pivot_mm": ("p of indentation = depth + offset + p (1 - cos tilt)", _MM),
    "yaw_deg": (
        "direction in the image in which the contact of a tilted plate moves",
        {"low": -360.0, "high": 360.0},
    ),
    "sensor": ("name of the sensor that was recorded", {}),
    "licence": ("of the frames, an SPDX name such as CC-BY-4.0", {}),
}

_DEFAULTS = ImportOptions()

PARAMETERS = tuple(
    Parameter(name, getattr(_DEFAULTS, name), text, **limits)
    for name, (text, limits) in _HELP.items()
)


def read_options(texts: Iterable[str]) -> ImportOptions:
    """``("indenter=plate", "offset_mm=5")`` -> options. Raises UserError."""
    known: Mapping[str, Parameter] = {parameter.name: parameter for parameter in PARAMETERS}
    values: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise UserError(
                f"--param {text!r} is not understood; write NAME=VALUE, for example "
                "--param indenter=plate."
            )
        if name not in known:
            raise UserError(f"there is no parameter {name!r}; {did_you_mean(name, known)}")
        if name in values:
            raise UserError(f"--param {name} is given twice; give it once.")
        values[name] = known[name].parse(value)
    return ImportOptions(**values)
