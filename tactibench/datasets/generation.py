"""Generation of a data set: presses of a plan, and a sensor that is pressed.

A plan holds series of presses, each with a seed of its own, so that its frames do not depend on the
process that presses it. Existing samples are not pressed again.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ConfigDict, NonNegativeInt, TypeAdapter, ValidationError

from tactibench.contacts import Scene, Signal
from tactibench.datasets.schema import (
    Draft,
    Header,
    SceneKeys,
    is_dataset,
    plan_hash,
    plan_lines,
    read_header,
    read_plan,
    scene_keys,
)
from tactibench.datasets.writer import Writer
from tactibench.errors import UserError
from tactibench.geometry import DOME_RADIUS_MM
from tactibench.plugins import PluginHost, Sensor, SensorContext, SensorSpec, Value
from tactibench.protocols import (
    CHUNK,
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
    load_protocol,
    pressable,
    split_presses,
)
from tactibench.records import code_hash, digest, installed_versions

DEFAULT_SENSOR = "tactip-127"
"""Sensor of a request that names neither a sensor nor a protocol."""
PLAN_SUFFIX = ".jsonl"
"""End of the name of a plan's file; everything else is a protocol."""
GROUP = 50
"""Samples that are acknowledged together."""

Advance = Callable[[int], None]


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


def plan_presses(
    what: str, sensor: SensorShape, *, seed: int | None = None, count: int | None = None
) -> PressPlan:
    """Return all presses of a protocol or of a plan.jsonl.

    Args:
        what: Name or file of a protocol, or a file that ends in .jsonl.
        sensor: The sensor whose surface is pressed.
        seed: Seed with which other presses than the protocol's are drawn; None for the protocol's.
        count: Most presses of each set; None takes all.

    Raises:
        UserError: There is no such protocol or file, or the sensor cannot be pressed in this way.
    """
    if what.endswith(PLAN_SUFFIX):
        return plan_of_file(Path(what), seed or 0, count)
    protocol = load_protocol(what).spec
    if seed is not None:
        protocol = protocol.model_copy(update={"data_seed": seed})
    return plan_of_protocol(protocol, sensor, count)


def plan_of_file(path: Path, seed: int, count: int | None = None) -> PressPlan:
    """Return the presses of a plan.jsonl.

    Args:
        path: The file.
        seed: Seed of the sensor's randomness.
        count: Most presses to take; None takes all.

    Raises:
        UserError: The file is missing or empty, or a line is wrong; the sentence names it.
    """
    if not path.is_file():
        raise UserError(f"{path} is no file; name a file of lines as in plan.jsonl.")
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
        raise UserError(f"{path} is empty; it needs a line for every press.")
    return PressPlan((PressSeries(tuple(presses[:count]), (seed,)),), {})


def plan_of_protocol(
    protocol: Protocol, sensor: SensorShape, count: int | None = None
) -> PressPlan:
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
            "another protocol, or a file of presses, such as plan.jsonl."
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
    test = [ids.get((n, TEST), []) + ids.get((n, WHOLE), []) for n in protocol.tested_draws]
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


@dataclass(frozen=True)
class SensorSource:
    """The sensor that presses.

    Attributes:
        build: Opens the sensor with a seed.
        identity: Name, parameters, code and description of the sensor.
        dome_radius_mm: Radius of its surface, inf where it is flat.
        request: The request, as the header's ``source`` states it.
    """

    build: Callable[[SensorContext], Sensor]
    identity: dict[str, Any]
    dome_radius_mm: float
    request: dict[str, Any] = field(default_factory=dict)


def sensor_source(spec: SensorSpec, values: Mapping[str, Value]) -> SensorSource:
    """Return the sensor of a spec with its parameters.

    Raises:
        UserError: The sensor does not load, or stands for several instances: a data set has one
            rest frame.
    """
    count = values.get("instances", 0)
    if isinstance(count, int) and count > 1:
        raise UserError(
            f"sensor.instances={count} presses {count} sensor instances, but a data set holds the "
            "rest frame of one; write a data set for each, with --param sensor.instance=N."
        )
    build = partial(spec.build, **values)
    sensor = build(_context((0,)))
    identity = {
        "name": spec.name,
        "origin": spec.origin,
        "parameters": dict(values),
        "code": code_hash(spec.target.partition(":")[0].partition(".")[0]),
        "describe": sensor.describe(),
        "versions": installed_versions("tactibench", "numpy"),
    }
    radius = DOME_RADIUS_MM if sensor.dome_radius_mm is None else sensor.dome_radius_mm
    return SensorSource(build, identity, radius)


def resolve_presses(
    what: str,
    sensor: str | None,
    parameters: Mapping[str, str],
    count: int | None = None,
    seed: int | None = None,
) -> tuple[PressPlan, SensorSource]:
    """Return the presses of ``tactibench data generate``, and the sensor that makes them.

    Args:
        what: Name or file of a protocol, or a plan: a file that ends in .jsonl.
        sensor: Name of the sensor; None takes the protocol's.
        parameters: Name and value of the sensor's parameters.
        count: Most presses of each set.
        seed: Seed of other presses than the protocol's, and of the sensor's randomness.

    Raises:
        UserError: A name is unknown, something cannot be read or pressed, or the sensor reads
            recordings.
    """
    facts: dict[str, Any] = {"plan": Path(what).name, "seed": seed or 0}
    name = sensor or DEFAULT_SENSOR
    if not what.endswith(PLAN_SUFFIX):
        loaded = load_protocol(what)
        drawn = loaded.spec.data_seed if seed is None else seed
        facts = {"protocol": loaded.label, "sha256": loaded.hash, "seed": drawn}
        name = sensor or loaded.spec.defaults.sensor
    spec = PluginHost().sensors[name]
    if spec.needs_data:
        raise UserError(f"sensor {name!r} reads what was recorded; take `tactibench data import`.")
    source = sensor_source(spec, spec.settings(parameters))
    plan = plan_presses(what, source.build(_context((0,))), seed=seed, count=count)
    request = {"importer": "tactibench data generate", "count": count, **facts}
    return plan, replace(source, request=request)


def is_complete(folder: Path, source: SensorSource, plan: PressPlan) -> bool:
    """Return whether the folder holds exactly this data set, and it is closed."""
    if not is_dataset(folder):
        return False
    header = read_header(folder)
    facts, expected = [header.sensor, header.source], [source.identity, source.request]
    return (
        header.status == "closed"
        and digest(facts) == digest(expected)
        and header.plan_sha256 == plan_hash(plan_lines(press_rows(plan)))
    )


def generate(folder: Path, source: SensorSource, plan: PressPlan, advance: Advance) -> None:
    """Write the frames of all presses into a data set and close it; an open one is continued.

    A chunk of presses that was begun is pressed again from its start, so that its frames are the
    same as without an interruption.

    Args:
        folder: Folder of the data set.
        source: The sensor.
        plan: The presses.
        advance: Called with the number of presses that exist already, and then with the number of
            presses of every finished chunk.

    Raises:
        UserError: The folder holds files but no data set, or another data set.
    """
    rest = _rest_signal(source, plan)
    camera = rest.dtype == np.uint8
    header = Header(
        source.identity["name"],
        source.identity,
        (rest.shape[0], rest.shape[1]) if camera else None,
        3 if camera and rest.ndim == 3 else 1,
        source.dome_radius_mm,
        () if camera else rest.shape,
        source=source.request,
    )
    with Writer(folder, header, press_rows(plan)) as writer:
        writer.reference(rest)
        missing = [
            chunk
            for chunk in plan.chunks(CHUNK)
            if not writer.done.issuperset(press.id for press in chunk.presses)
        ]
        advance(len(list(plan)) - sum(len(chunk.presses) for chunk in missing))
        for chunk in missing:
            done = writer.done
            new = (draft for draft in press_series(source, chunk) if draft.id not in done)
            while group := list(islice(new, GROUP)):
                writer.add_many(group)
            advance(len(chunk.presses))
        for name, subsets in plan.splits.items():
            writer.split(name, **subsets)


def press_series(source: SensorSource, series: PressSeries) -> Iterator[Draft]:
    """Press a series, and yield its samples in order, each as soon as it is made."""
    with source.build(_context(series.seed)) as sensor:
        frames = sensor.press_many([press.scene for press in series.presses])
        for press, frame in zip(series.presses, frames, strict=True):
            scene = replace(press.scene, pose=frame.pose)
            extra = {"draw": press.draw} if press.draw else {}
            force = None if frame.force is None else tuple(map(tuple, frame.force.tolist()))
            draft = Draft(frame.signal, press.id, scene, press=press.name, extra=extra)
            yield replace(draft, contacts_force_n=force)


def _rest_signal(source: SensorSource, plan: PressPlan) -> Signal:
    with source.build(_context((*plan.series[0].seed, 0))) as sensor:
        return sensor.rest().signal


def _context(seed: tuple[int, ...]) -> SensorContext:
    """Return the context of a sensor with a root seed and spawn key."""
    return SensorContext(np.random.SeedSequence(seed[0], spawn_key=seed[1:]))
