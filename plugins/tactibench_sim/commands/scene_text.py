"""Scenes as a person writes them: one line such as "dual:7@x=1,yaw=30,depth=2", or a TOML file."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tactibench import Indenter, Pose, Scene, UserError

POSE = ("x", "y", "yaw", "tilt", "depth", "dx", "dy", "dyaw")
KINDS: Mapping[str, tuple[str, ...]] = {
    "single": ("radius",),
    "dual": ("distance", "radius"),
    "triple": ("heights", "side", "radius"),
    "plate": (),
    "custom": ("offsets", "radius"),
}
"""Indenter -> names that it may have besides those of the pose; "custom" only in a file."""
NUMBERS_FIRST = {"dual": "distance", "triple": "heights"}
"""Names of the numbers behind the colon of a line."""

HELP = """KIND[:NUMBERS][@NAME=VALUE,...], or a .toml file with the same names

\b
single@x=3,y=-2,depth=3           one spherical tip
dual:7@yaw=30,depth=2             two tips 7 mm apart
triple:0,1,2@depth=3              three tips, height inserts in mm
triple:0,0,0@side=10,depth=3      ... on a triangle of 10 mm (default 8)
plate@tilt=10,yaw=45,depth=2      a flat plate
\b
x, y, depth in mm, yaw and tilt (plates only) in deg; radius of the tips in mm (default 3).
dx, dy in mm and dyaw in deg: the way that the indenter went sideways after first touch, which
drags the skin where the sensor has friction (--param friction=0.5).
\b
In a file:  indenter = "triple"   heights = [0.0, 1.0, 2.0]   depth = 3.0
or          indenter = "custom"   offsets = [[0, 0, 0], [8, 0, 0.5]]   depth = 2.0
"""


def read_scene(text: str) -> Scene:
    """Read a scene from a line or from a file whose name ends in .toml.

    Raises:
        UserError: The file cannot be read, or the line or the file describes no scene.
    """
    if text.endswith(".toml"):
        return _build(_file(Path(text)), f"the scene file {text}")
    return _build(_line(text), f"the scene {text!r}")


def _line(text: str) -> dict[str, Any]:
    head, at, tail = text.partition("@")
    kind, colon, numbers = head.partition(":")
    given: dict[str, Any] = {"indenter": kind.strip()}
    if colon:
        key = NUMBERS_FIRST.get(kind.strip())
        if key is None and kind.strip() in KINDS:
            raise UserError(
                f"the scene {text!r} has numbers behind {kind.strip()!r}; only "
                f"{' and '.join(NUMBERS_FIRST)} take some."
            )
        row = [_number(number, text) for number in numbers.split(",")]
        given[key or "numbers"] = row[0] if key == "distance" and len(row) == 1 else row
    for pair in tail.split(",") if at else ():
        name, equals, value = pair.partition("=")
        if not equals:
            raise UserError(f"the scene {text!r} holds {pair!r}; write NAME=VALUE, e.g. depth=2.")
        if name.strip() in given:
            raise UserError(f"the scene {text!r} says {name.strip()!r} twice; say it once.")
        given[name.strip()] = _number(value, text)
    return given


def _number(text: str, scene: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise UserError(f"the scene {scene!r} holds {text!r} where a number must be.") from None


def _file(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise UserError(f"the scene file {path} does not exist.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as error:
        raise UserError(f"the scene file {path} cannot be read as TOML: {error}.") from None


def _build(given: Mapping[str, Any], where: str) -> Scene:
    from tactibench.lab import did_you_mean  # the help of `sim render` needs this module alone

    kind = given.get("indenter")
    if not isinstance(kind, str) or kind not in KINDS:
        raise UserError(f"{where} has the indenter {kind!r}; {did_you_mean(str(kind), KINDS)}")
    allowed = (*KINDS[kind], *POSE)
    for name in given:
        if name not in ("indenter", *allowed):
            raise UserError(
                f"{where} says {name!r}, which {kind} has not; {did_you_mean(name, allowed)}"
            )
    if "depth" not in given:
        raise UserError(f"{where} has no depth, so it touches nothing; add for example depth=2.")
    if kind == "plate" and ("x" in given or "y" in given):
        raise UserError(
            f"{where} gives a plate x or y; a plate has only yaw, tilt, depth and dx, dy, dyaw."
        )
    pose = Pose(**{name: _value(given, name, where) for name in POSE if name in given})
    return Scene(_indenter(kind, given, where), pose)


def _indenter(kind: str, given: Mapping[str, Any], where: str) -> Indenter:
    radius = _value(given, "radius", where, 3.0, positive=True)
    if kind == "plate":
        return Indenter.plate()
    if kind == "single":
        return Indenter.single(radius)
    if kind == "dual":
        _require(given, "distance", where, "dual:7")
        return Indenter.dual(_value(given, "distance", where, positive=True), radius)
    if kind == "triple":
        _require(given, "heights", where, "triple:0,1,2")
        heights = _row(given["heights"], 3, f"the heights of {where}")
        side = _value(given, "side", where, 8.0, positive=True)
        return Indenter.triple((heights[0], heights[1], heights[2]), side, radius)
    _require(given, "offsets", where, "offsets = [[0, 0, 0], [8, 0, 0]]")
    offsets = given["offsets"]
    if not isinstance(offsets, list) or not offsets:
        raise UserError(f"the offsets of {where} must be a list of [dx, dy, dz] in mm.")
    rows = [_row(offset, 3, f"an offset of {where}") for offset in offsets]
    return Indenter(radius, tuple((r[0], r[1], r[2]) for r in rows), "custom")


def _require(given: Mapping[str, Any], name: str, where: str, example: str) -> None:
    if name not in given:
        raise UserError(f"{where} does not say its {name}; write for example {example}.")


def _row(values: Any, count: int, title: str) -> list[float]:
    good = isinstance(values, list) and len(values) == count and all(map(_is_number, values))
    if not good:
        raise UserError(f"{title} must be {count} numbers in mm, not {values!r}.")
    return [float(value) for value in values]


def _value(
    given: Mapping[str, Any], name: str, where: str, default: float = 0.0, positive: bool = False
) -> float:
    value = given.get(name, default)
    if not _is_number(value) or (positive and not value > 0):
        kind = "a number above 0" if positive else "a finite number"
        raise UserError(f"{where} has the {name} {value!r}; it must be {kind}.")
    return float(value)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
