"""Pressing a sensor and writing its frames; what is there already is not written again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Frame
from tactibench.datasets import Draft, Header, Writer, is_dataset
from tactibench.datasets.generating.stretches import Press, Pressing
from tactibench.datasets.rows import plan_hash, plan_lines
from tactibench.datasets.schema import read_header
from tactibench.frames.cache import CHUNK
from tactibench.geometry import DOME_RADIUS_MM
from tactibench.plugins.base import Sensor, SensorContext
from tactibench.plugins.specs import SensorSpec, Value
from tactibench.records.identity import code_hash, digest, installed_versions

GROUP = 50
"""Samples that are acknowledged together."""

Advance = Callable[[int], None]
T = TypeVar("T")


@dataclass(frozen=True)
class Shard:
    """A chunk of a stretch. seed: root seed and spawn key, its own: whoever presses a shard, and
    whenever, the frames are the same."""

    presses: tuple[Press, ...]
    seed: tuple[int, ...]


Presser = Callable[[Sequence[Shard], Header], Iterator[Iterable[Draft]]]
"""Presses shards of a data set with that header; gives the drafts of each, in order."""


@dataclass(frozen=True)
class Source:
    """Where frames come from. build: opens the sensor with a seed. identity: name, parameters,
    code and description. dome_radius_mm: of its surface. asked: what the command was."""

    build: Callable[[SensorContext], Sensor]
    identity: dict[str, Any]
    dome_radius_mm: float
    asked: dict[str, Any] = field(default_factory=dict)

    def with_asked(self, asked: dict[str, Any]) -> Source:
        return replace(self, asked=asked)


def source_of(spec: SensorSpec, values: Mapping[str, Value]) -> Source:
    """The sensor of a spec. Raises UserError when it does not load."""
    target = spec.load()

    def build(context: SensorContext) -> Sensor:
        sensor: Sensor = target(context, **values)
        return sensor

    sensor = build(SensorContext(np.random.SeedSequence(0)))
    identity = {
        "name": spec.name,
        "origin": spec.origin,
        "parameters": dict(values),
        "code": code_hash(spec.target.partition(":")[0].partition(".")[0]),
        "describe": sensor.describe(),
        "versions": installed_versions("tactibench", "numpy"),
    }
    radius = DOME_RADIUS_MM if sensor.dome_radius_mm is None else sensor.dome_radius_mm
    return Source(build, identity, radius)


def is_complete(folder: Path, source: Source, pressing: Pressing) -> bool:
    """Whether the folder holds just this, closed."""
    if not is_dataset(folder):
        return False
    header = read_header(folder)
    same = digest([header.sensor, header.source]) == digest(
        [source.identity, source.asked]
    ) and header.plan_sha256 == plan_hash(plan_lines(pressing.rows()))
    return header.status == "closed" and same


def generate(
    folder: Path,
    source: Source,
    pressing: Pressing,
    advance: Advance,
    presser: Presser | None = None,
) -> None:
    """Write the frames of all presses into a data set and close it; goes on with an open one.

    ``advance`` is told of presses that are there. presser: who presses; None: this process. Raises
    UserError when the folder holds something else.
    """
    rest = _rest(source, pressing)
    header = _header(source, rest)
    with Writer(folder, header, pressing.rows()) as writer:
        writer.reference(rest)
        shards = shards_of(pressing)
        missing = [shard for shard in shards if not writer.done.issuperset(_ids(shard))]
        advance(sum(len(s.presses) for s in shards) - sum(len(s.presses) for s in missing))
        pressed = presser(missing, header) if presser else (drafts(source, s) for s in missing)
        for shard, found in zip(missing, pressed, strict=True):
            done = writer.done
            for group in _batches((draft for draft in found if draft.id not in done), GROUP):
                writer.add_many(group)
            advance(len(shard.presses))
        for name, parts in pressing.splits.items():
            writer.split(name, **parts)


def shards_of(pressing: Pressing) -> list[Shard]:
    """All presses in chunks. A chunk's randomness depends on its number alone: one that was begun
    is pressed again from its start, so that its frames are what they would have been."""
    return [
        Shard(tuple(presses), (*stretch.seed, number))
        for stretch in pressing.stretches
        for number, presses in enumerate(_batches(stretch.presses, CHUNK))
    ]


def drafts(source: Source, shard: Shard) -> Iterator[Draft]:
    """Press a shard: its samples in order, each as soon as it is asked for."""
    with source.build(SensorContext(_sequence(shard.seed))) as sensor:
        frames = sensor.press_many([press.scene for press in shard.presses])
        for press, frame in zip(shard.presses, frames, strict=True):
            yield _draft(press, frame)


def _ids(shard: Shard) -> list[int]:
    return [press.id for press in shard.presses]


def _draft(press: Press, frame: Frame) -> Draft:
    scene = replace(press.scene, pose=frame.pose)
    extra = {"draw": press.draw} if press.draw else {}
    return Draft(frame.image, press.id, scene, press=press.name, extra=extra)


def _rest(source: Source, pressing: Pressing) -> npt.NDArray[np.uint8]:
    with source.build(SensorContext(_sequence((*pressing.stretches[0].seed, 0)))) as sensor:
        return sensor.rest().image


def _header(source: Source, rest: npt.NDArray[np.uint8]) -> Header:
    return Header(
        source.identity["name"],
        source.identity,
        (rest.shape[0], rest.shape[1]),
        3 if rest.ndim == 3 else 1,
        source.dome_radius_mm,
        source=source.asked,
    )


def _sequence(seed: tuple[int, ...]) -> np.random.SeedSequence:
    return np.random.SeedSequence(seed[0], spawn_key=seed[1:])


def _batches(things: Iterable[T], count: int) -> Iterator[list[T]]:
    """Lists of ``count`` things, the last one shorter (itertools.batched of newer Pythons)."""
    rest = iter(things)
    while batch := list(islice(rest, count)):
        yield batch
