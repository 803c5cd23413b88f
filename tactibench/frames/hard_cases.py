"""Test frames of hard cases, in place of those that a protocol draws.

Scenes are pressed; faults are done, when they are asked for, to the frames of the base family.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tactibench.contacts import Frame, Scene
from tactibench.errors import UserError
from tactibench.frames.faults import FAULTS
from tactibench.frames.hard_scenes import case_scene
from tactibench.frames.presser import Presser
from tactibench.frames.presses import Presses
from tactibench.frames.source import Advance, Wanted, scored_limit, spread
from tactibench.plugins.specs import SensorSpec
from tactibench.protocols.families import Cases, Family, case
from tactibench.protocols.schema import Protocol
from tactibench.records.files import arrays_hash
from tactibench.records.identity import combined, digest
from tactibench.run.components import Part, Sensors
from tactibench.run.request import RunRequest

PART = 5
"""Of a family, beside those of ``frames_drawn`` and ``frames_reference``."""
DAMAGED = 1_000
"""Last word of the spawn key behind the faults of a press; the others stand behind its scene."""

Row = tuple[str, float, int]
"""Family, value, number of the press."""


def hard_frames(request: RunRequest, tester: Presser) -> tuple[Wanted, ...]:
    """Frames of all families, in their order. Raises UserError for a sensor that cannot be set so.

    A limit takes frames that are spread evenly over all cases.
    """
    if request.tested.reference:
        raise UserError(
            f"protocol {tester.keys.id!r} presses hard cases of its own and has no reference "
            "scenes; leave --test reference out."
        )
    if math.isinf(tester.pressed.workspace.dome_radius_mm):
        raise UserError(
            f"protocol {tester.keys.id!r} presses a dome as far as its edge, but sensor "
            f"{tester.part.name!r} is flat; take a sensor with a dome."
        )
    maker = _Maker(tester, tester.pressed)
    kept = spread(maker.rows, scored_limit(request))
    wanted: list[Wanted] = []
    for family in tester.keys.families:
        rows = [row for row in kept if row[0] == family.name]
        if rows:
            wanted += maker.family(family, rows)
    return tuple(wanted)


@dataclass(frozen=True)
class _Maker:
    """tester: presses the nominal cases. keys: the protocol on the sensor's own surface."""

    tester: Presser
    keys: Protocol

    @cached_property
    def cases(self) -> Cases:
        assert self.keys.cases is not None  # noqa: S101 - the schema asks for it
        return self.keys.cases

    @cached_property
    def base(self) -> Family:
        return self.keys.family(self.cases.base)

    @cached_property
    def rows(self) -> list[Row]:
        """Every frame of every case."""
        return [
            (family.name, value, k)
            for family in self.keys.families
            for value in family.pressed_values
            for k in range(family.presses or self.cases.presses)
        ]

    def family(self, family: Family, rows: Sequence[Row]) -> list[Wanted]:
        if family.press is not None:
            return [self._pressed(family, rows)]
        if family.fault is not None:
            return [self._faulty(family, rows)]
        return [
            self._by_another(family, value, [row for row in rows if row[1] == value])
            for value in dict.fromkeys(value for _, value, _ in rows)
        ]

    def _pressed(self, family: Family, rows: Sequence[Row]) -> Wanted:
        presser = _with(self.tester, family, family.sensor)
        scenes = [self._scene(family, value, k) for _, value, k in rows]
        return self._want(presser, family, rows, scenes)

    def _by_another(self, family: Family, value: float, rows: Sequence[Row]) -> Wanted:
        presser = _with(self.tester, family, {str(family.parameter): f"{value:g}"})
        scenes = [self._scene(self.base, self.base.values[0], k) for _, _, k in rows]
        return self._want(presser, family, rows, scenes)

    def _want(
        self, presser: Presser, family: Family, rows: Sequence[Row], scenes: Sequence[Scene]
    ) -> Wanted:
        own = family.press is not None
        names = [f"{case(name, value)}-{k}" for name, value, k in rows]
        presses = [f"{family.name if own else self.base.name}-{k}" for _, _, k in rows]
        wanted = presser.want(
            "test", family.name, scenes, names, PART, presses, stream=family.stream
        )
        return replace(wanted, groups=tuple(case(name, value) for name, value, _ in rows))

    def _faulty(self, family: Family, rows: Sequence[Row]) -> Wanted:
        value, count = self.base.values[0], self.base.presses or self.cases.presses
        base = self._pressed(self.base, [(self.base.name, value, k) for k in range(count)])
        damage = Damage(str(family.fault), self.tester.keys.data_seed, family.stream, tuple(rows))
        return Wanted(
            "test",
            family.name,
            tuple(base.scenes[k] for _, _, k in rows),
            tuple(case(name, value) for name, value, _ in rows),
            base.cached,
            digest([base.key, damage.fault, damage.data_seed, damage.stream, rows]),
            lambda advance: damaged(base, damage, advance),
            tuple(base.presses[k] for _, _, k in rows),
            tuple(f"{case(name, value)}-{k}" for name, value, k in rows),
        )

    def _scene(self, family: Family, value: float, k: int) -> Scene:
        seed = np.random.SeedSequence(self.keys.data_seed, spawn_key=(family.stream, k))
        return case_scene(family, value, self.keys.workspace, seed)


@dataclass(frozen=True)
class Damage:
    """A fault of every one of ``rows``, drawn from a stream of the data seed."""

    fault: str
    data_seed: int
    stream: int
    rows: tuple[Row, ...]


def damaged(base: Wanted, damage: Damage, advance: Advance) -> Presses:
    """The frames of the base with a fault each; the rest frame stays as it was before the fault.

    Press k has the same random numbers for every value, so that a greater one is the same fault,
    grown.
    """
    whole = base.open(lambda _: None)
    frames: list[Frame] = []
    for _, value, k in damage.rows:
        seed = np.random.SeedSequence(damage.data_seed, spawn_key=(damage.stream, k, DAMAGED))
        frame = whole.frames[k]
        image = FAULTS[damage.fault](np.array(frame.image), value, np.random.default_rng(seed))
        image.setflags(write=False)
        frames.append(replace(frame, image=image))
        advance(1)
    rows = [f"{case(name, value)}-{k}" for name, value, k in damage.rows]
    images = arrays_hash({"images": np.stack([frame.image for frame in frames])})
    content = combined([whole.hash, images, *rows])
    scenes = tuple(whole.scenes[k] for _, _, k in damage.rows)
    return Presses(whole.name, scenes, frames, tuple(rows), content, None, whole.dome_radius)


def _with(tester: Presser, family: Family, given: dict[str, str]) -> Presser:
    """The presser with other parameters of its sensor. Raises UserError."""
    if not given:
        return tester
    spec: SensorSpec = tester.part.spec
    try:
        changed = spec.settings(given)
    except UserError as error:
        raise UserError(
            f"family {family.name!r} of protocol {tester.keys.id!r} changes the sensor: {error}"
        ) from None
    values = {
        name: changed[name] if name in given else value
        for name, value in tester.part.values.items()
    }
    part = Part(spec, values, tester.part.origin)
    build = Sensors(sensor=part, regime="").build_sensor
    return Presser(tester.keys, part, build, tester.cache, tester.secret)
