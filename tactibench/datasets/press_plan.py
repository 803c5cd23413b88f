"""Plans of presses: series of presses, each with a seed of its own."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, NonNegativeInt, TypeAdapter, ValidationError

from tactibench.contacts import Scene
from tactibench.datasets.rows import SceneKeys, read_plan, scene_keys
from tactibench.errors import UserError
from tactibench.protocols import (
    FIT,
    TEST,
    VALIDATION,
    WHOLE,
    Draw,
    Protocol,
    SensorShape,
    Split,
    draw_scenes,
    first_mistake,
    pressable,
    split_presses,
)


@dataclass(frozen=True)
class Press:
    """A press of a plan.

    Attributes:
        id: Id of its sample.
        name: Name of the press, which its samples share.
        scene: Indenter and pose.
        draw: Name of the draw that it comes from.
    """

    id: int
    name: str
    scene: Scene
    draw: str = ""


@dataclass(frozen=True)
class PressSeries:
    """Presses in order, whose frames do not depend on the process that presses them, or the time.

    Attributes:
        presses: The presses.
        seed: Root seed and spawn key of the sensor's randomness.
    """

    presses: tuple[Press, ...]
    seed: tuple[int, ...]


@dataclass(frozen=True)
class PressPlan:
    """All presses of a data set.

    Attributes:
        series: Series of presses.
        splits: Name of a split -> subset -> ids.
    """

    series: tuple[PressSeries, ...]
    splits: Mapping[str, Mapping[str, Sequence[int]]]

    def __iter__(self) -> Iterator[Press]:
        return (press for series in self.series for press in series.presses)

    def rows(self) -> list[dict[str, Any]]:
        """Return the rows of plan.jsonl."""
        return press_rows(self)

    def chunks(self, size: int) -> list[PressSeries]:
        """Return all presses in series of at most ``size``, each with a seed by its number."""
        return [
            PressSeries(series.presses[start : start + size], (*series.seed, start // size))
            for series in self.series
            for start in range(0, len(series.presses), size)
        ]


def press_rows(presses: Iterable[Press]) -> list[dict[str, Any]]:
    """Return the rows of plan.jsonl for presses."""
    return [{"id": p.id, "press": p.name, "draw": p.draw, **scene_keys(p.scene)} for p in presses]


@dataclass(frozen=True, kw_only=True)
class _Row(SceneKeys):
    """A line of a plan that a person wrote: angles may be left out."""

    __pydantic_config__ = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)

    id: NonNegativeInt
    press: str = ""
    draw: str = ""
    yaw_deg: float | None = 0.0
    tilt_deg: float | None = 0.0


_ROW_FILE = TypeAdapter(_Row)


def plan_of_file(path: Path, seed: int, count: int | None) -> PressPlan:
    """Return the presses of a plan.jsonl.

    Args:
        path: The file.
        seed: Seed of the sensor's randomness.
        count: Most presses to take; None takes all.

    Raises:
        UserError: The file is missing or empty, or a line is wrong; the sentence names it.
    """
    if not path.is_file():
        raise UserError(f"--plan {path} is no file; name a file of lines as in plan.jsonl.")
    presses = []
    for number, row in enumerate(read_plan(path), start=1):
        where = f"{path} line {number}"
        try:
            planned = _ROW_FILE.validate_json(json.dumps(row))
        except ValidationError as error:
            raise UserError(f"{where}: {first_mistake(error, _Row)}") from None
        scene = planned.scene(where)
        if scene is None:
            raise UserError(f"{where}: the key 'indenter' is missing; add it.")
        presses.append(Press(planned.id, planned.press or str(planned.id), scene, planned.draw))
    if not presses:
        raise UserError(f"--plan {path} is empty; it needs a line for every press.")
    return PressPlan((PressSeries(tuple(presses[:count]), (seed,)),), {})


def plan_of_protocol(protocol: Protocol, sensor: SensorShape, count: int | None) -> PressPlan:
    """Return every press that a protocol trains, validates and tests on.

    The frames are those of ``tactibench run``: presses, their order and their seeds are the same.

    Args:
        protocol: The protocol.
        sensor: The sensor whose surface is pressed.
        count: Most presses of each set; None takes all.

    Raises:
        UserError: The protocol draws no presses or tests hard cases, or the sensor cannot be
            pressed as deep as it asks.
    """
    split = protocol.split
    if split is None:
        raise UserError(
            f"protocol {protocol.id!r} takes the presses of a recorded folder and draws none; name "
            "another protocol, or the presses with --plan FILE."
        )
    if protocol.families:
        raise UserError(
            f"protocol {protocol.id!r} tests frames with faults, which no data set holds; its "
            "training presses are those of exp1: generate these."
        )
    pressed = pressable(protocol, sensor)
    ids: dict[tuple[str, int], list[int]] = {}
    all_series = []
    start = 0
    for draw, rows, part in _subsets(protocol, split):
        scenes = draw_scenes(pressed, draw).scenes
        presses = tuple(
            Press(number, f"{draw}-{row}", scenes[row], draw)
            for number, row in enumerate(rows[:count], start)
        )
        start += len(presses)
        seed = (protocol.data_seed, protocol.draw(draw).stream, part)
        all_series.append(PressSeries(presses, seed))
        ids[draw, part] = [press.id for press in presses]
    return PressPlan(tuple(all_series), _splits(protocol, split, ids))


def _subsets(protocol: Protocol, split: Split) -> list[tuple[str, Sequence[int], int]]:
    """Return the draws, with rows of each, and the number of the part that these rows are."""
    sizes = {draw.name: _size(draw) for draw in protocol.draws}
    divided = split_presses(sizes[split.draw], split, protocol.data_seed)
    subsets: list[tuple[str, Sequence[int], int]] = [
        (split.draw, divided.fit, FIT),
        (split.draw, divided.validation, VALIDATION),
    ]
    if split.draw in protocol.test.sets:
        subsets.append((split.draw, divided.test, TEST))
    names = [name for regime in protocol.regimes.values() for name in regime]
    draws = dict.fromkeys([*names, *protocol.tested_draws])
    return subsets + [(name, range(sizes[name]), WHOLE) for name in draws if name != split.draw]


def _size(draw: Draw) -> int:
    return draw.count or (draw.per_distance or 0) * len(draw.distances_mm)


def _splits(
    protocol: Protocol, split: Split, ids: Mapping[tuple[str, int], list[int]]
) -> dict[str, dict[str, list[int]]]:
    """Return one split per regime: the ids that train and validate in it, and those of the test."""
    test = [
        ids.get((name, TEST), []) + ids.get((name, WHOLE), []) for name in protocol.tested_draws
    ]
    return {
        f"{protocol.id}-{regime}": {
            "train": [
                *ids[split.draw, FIT],
                *(number for name in names for number in ids[name, WHOLE]),
            ],
            "validation": ids[split.draw, VALIDATION],
            "test": [number for numbers in test for number in numbers],
        }
        for regime, names in protocol.regimes.items()
    }
