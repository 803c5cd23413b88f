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
from tactibench.datasets.generated import CHUNK
from tactibench.datasets.generating.stretches import Press, Pressing, Stretch
from tactibench.datasets.v1 import Draft, Header, Writer, is_dataset
from tactibench.datasets.v1.header import read_header
from tactibench.datasets.v1.plan import plan_hash, plan_text
from tactibench.geometry import DOME_RADIUS_MM, HasShape
from tactibench.plugins.interfaces import Sensor, SensorContext
from tactibench.plugins.specs import SensorSpec, Value
from tactibench.records.identity import code_hash, digest, installed_versions

GROUP = 50
"""Samples that are acknowledged together."""

Advance = Callable[[int], None]
T = TypeVar("T")


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
    radius = sensor.dome_radius_mm if isinstance(sensor, HasShape) else DOME_RADIUS_MM
    return Source(build, identity, radius)


def is_complete(folder: Path, source: Source, pressing: Pressing) -> bool:
    """Whether the folder holds just this, closed."""
    if not is_dataset(folder):
        return False
    header = read_header(folder)
    same = digest([header.sensor, header.source]) == digest(
        [source.identity, source.asked]
    ) and header.plan_sha256 == plan_hash(plan_text(pressing.rows()))
    return header.status == "closed" and same


def generate(folder: Path, source: Source, pressing: Pressing, advance: Advance) -> None:
    """Write the frames of all presses into a data set and close it; goes on with an open one.

    ``advance`` is told of presses that are there. Raises UserError when the folder holds something
    else.
    """
    rest = _rest(source, pressing)
    header = _header(source, rest)
    with Writer(folder, header, pressing.rows()) as writer:
        writer.reference(rest)
        for stretch in pressing.stretches:
            for number, presses in enumerate(_batches(stretch.presses, CHUNK)):
                _press(writer, source, stretch, number, presses)
                advance(len(presses))
        for name, parts in pressing.splits.items():
            writer.split(name, **parts)


def _press(
    writer: Writer, source: Source, stretch: Stretch, number: int, presses: Sequence[Press]
) -> None:
    """A chunk's randomness depends on its number alone: one that was begun is pressed again from
    its start, so that its frames are what they would have been."""
    done = writer.done
    if all(press.id in done for press in presses):
        return
    with source.build(SensorContext(_seed(stretch, number))) as sensor:
        frames = sensor.press_many([press.scene for press in presses])
        drafts = (
            _draft(press, frame)
            for press, frame in zip(presses, frames, strict=True)
            if press.id not in done
        )
        for group in _batches(drafts, GROUP):
            writer.add_many(group)


def _draft(press: Press, frame: Frame) -> Draft:
    scene = replace(press.scene, pose=frame.pose)
    extra = {"draw": press.draw} if press.draw else {}
    return Draft(frame.image, press.id, scene, press=press.name, extra=extra)


def _rest(source: Source, pressing: Pressing) -> npt.NDArray[np.uint8]:
    with source.build(SensorContext(_seed(pressing.stretches[0], 0))) as sensor:
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


def _seed(stretch: Stretch, chunk: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(stretch.seed[0], spawn_key=(*stretch.seed[1:], chunk))


def _batches(things: Iterable[T], count: int) -> Iterator[list[T]]:
    """Lists of ``count`` things, the last one shorter (itertools.batched of newer Pythons)."""
    rest = iter(things)
    while batch := list(islice(rest, count)):
        yield batch
