"""What is to be pressed: stretches of presses, each with a seed of its own."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, NonNegativeInt, TypeAdapter, ValidationError

from tactibench.contacts import Scene
from tactibench.datasets.rows import SceneKeys, read_plan, scene_keys
from tactibench.errors import UserError
from tactibench.protocols.mistakes import first_mistake


@dataclass(frozen=True)
class Press:
    """id: in the data set. name: of the press, which its samples share. draw: where it is from."""

    id: int
    name: str
    scene: Scene
    draw: str = ""


@dataclass(frozen=True)
class Stretch:
    """Presses in order. seed: root seed and spawn key of the sensor's randomness."""

    presses: tuple[Press, ...]
    seed: tuple[int, ...]


@dataclass(frozen=True)
class Pressing:
    """All that is to be pressed. splits: name -> part -> ids."""

    stretches: tuple[Stretch, ...]
    splits: Mapping[str, Mapping[str, Sequence[int]]]

    def __iter__(self) -> Iterator[Press]:
        return (press for stretch in self.stretches for press in stretch.presses)

    def rows(self) -> list[dict[str, Any]]:
        """The rows of plan.jsonl."""
        return [{"id": p.id, "press": p.name, "draw": p.draw, **scene_keys(p.scene)} for p in self]


@dataclass(frozen=True, kw_only=True)
class _Row(SceneKeys):
    __pydantic_config__ = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)

    id: NonNegativeInt
    press: str = ""
    draw: str = ""
    yaw_deg: float | None = 0.0
    tilt_deg: float | None = 0.0


_FILE = TypeAdapter(_Row)


def from_file(path: Path, seed: int, count: int | None) -> Pressing:
    """The presses of a plan.jsonl, at most ``count``. Raises UserError with the line."""
    if not path.is_file():
        raise UserError(f"--plan {path} is no file; name a file of lines as in plan.jsonl.")
    presses = []
    for number, row in enumerate(read_plan(path), start=1):
        where = f"{path} line {number}"
        try:
            planned = _FILE.validate_json(json.dumps(row))
        except ValidationError as error:
            raise UserError(f"{where}: {first_mistake(error, _Row)}") from None
        scene = planned.scene(where)
        if scene is None:
            raise UserError(f"{where}: the key 'indenter' is missing; add it.")
        presses.append(Press(planned.id, planned.press or str(planned.id), scene, planned.draw))
    if not presses:
        raise UserError(f"--plan {path} is empty; it needs a line for every press.")
    return Pressing((Stretch(tuple(presses[:count]), (seed,)),), {})
