"""Which frames a run trains on, validates on and is tested on, and where they come from."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tactibench.contacts import Frame, Scene
from tactibench.datasets.generated import FrameRequest, is_cached, open_frames
from tactibench.datasets.presses import Presses
from tactibench.errors import UserError
from tactibench.plugins.interfaces import HasScenes, Sensor, SensorContext
from tactibench.protocols.draws import draw_scenes
from tactibench.protocols.loader import LoadedProtocol
from tactibench.protocols.schema import Protocol
from tactibench.protocols.split import split_presses, split_recorded
from tactibench.records.identity import combined, digest
from tactibench.running.parts import Parts
from tactibench.running.request import QUICK_FIT, QUICK_TEST, QUICK_VALIDATION, RunRequest

FIT, VALIDATION, TEST, DRAW = 0, 1, 2, 3
"""Parts of a draw; each has noise of its own."""

Advance = Callable[[int], None]


@dataclass(frozen=True)
class Wanted:
    """One set of presses that a run needs. group: of every press, in the result tables."""

    role: str
    name: str
    scenes: tuple[Scene, ...]
    groups: tuple[str, ...]
    open: Callable[[Advance], Presses] = field(repr=False)
    cached: bool
    key: str
    """Identity of the frames, known before they are made."""


@dataclass(frozen=True)
class FramePlan:
    """The frames of a run. rejected: candidates that geometry refused in the test draws."""

    fit: tuple[Wanted, ...]
    validation: tuple[Wanted, ...]
    test: tuple[Wanted, ...]
    rejected: int
    sensor_identity: dict[str, Any]

    def __iter__(self) -> Iterator[Wanted]:
        return iter((*self.fit, *self.validation, *self.test))

    def count(self, role: str) -> int:
        return sum(len(wanted.scenes) for wanted in self if wanted.role == role)

    def training_key(self) -> str:
        """Identity of what is handed to ``fit``."""
        return combined([f"{w.role} {w.key}" for w in (*self.fit, *self.validation)])


def plan_frames(
    request: RunRequest, protocol: LoadedProtocol, parts: Parts, cache: Path
) -> FramePlan:
    """Draw or look up all scenes; no frame is made yet. Raises UserError."""
    if parts.sensor.spec.needs_data:  # type: ignore[union-attr]
        return _recorded(request, protocol, parts)
    if protocol.keys.split is None:
        raise UserError(
            f"protocol {protocol.keys.id!r} takes the presses of a recorded folder, which sensor "
            f"{parts.sensor.name!r} does not have; use --sensor recorded --data DIR."
        )
    return _generated(request, protocol.keys, parts, cache)


def _generated(request: RunRequest, keys: Protocol, parts: Parts, cache: Path) -> FramePlan:
    with parts.build_sensor(SensorContext(np.random.SeedSequence(0))) as sensor:
        identity = {
            "name": parts.sensor.name,
            "code": parts.sensor.code(),
            "describe": sensor.describe(),
        }

    def want(role: str, name: str, scenes: Sequence[Scene], part: int) -> Wanted:
        frames = FrameRequest(
            name,
            parts.build_sensor,
            identity,
            tuple(scenes),
            (keys.data_seed, keys.draw(name).stream, part),
        )
        groups = tuple(_group(keys, name, scene) for scene in scenes)
        return Wanted(
            role,
            name,
            frames.scenes,
            groups,
            lambda advance: open_frames(frames, cache, advance),
            is_cached(frames, cache),
            frames.key,
        )

    assert keys.split is not None  # noqa: S101 - narrowed by the caller
    base = keys.split.draw
    drawn = draw_scenes(keys, base)
    split = split_presses(len(drawn.scenes), keys.split, keys.data_seed)
    pick = lambda rows: [drawn.scenes[i] for i in rows]  # noqa: E731
    extra = keys.regimes[parts.regime]
    fit_scenes = {base: pick(split.fit), **{n: draw_scenes(keys, n).scenes for n in extra}}
    validation = pick(split.validation)
    if request.quick:
        share = max(1, QUICK_FIT // len(fit_scenes))
        fit_scenes = {name: scenes[:share] for name, scenes in fit_scenes.items()}
        validation = validation[:QUICK_VALIDATION]
    tests, rejected = {}, 0
    for name in keys.test.sets:
        if name == base:
            tests[name] = pick(split.test)
        else:
            found = draw_scenes(keys, name)
            tests[name] = list(found.scenes)
            rejected += found.rejected
    tests = _thinned(tests, _test_limit(request))
    return FramePlan(
        tuple(
            want("fit", name, scenes, FIT if name == base else DRAW)
            for name, scenes in fit_scenes.items()
        ),
        (want("validation", base, validation, VALIDATION),),
        tuple(
            want("test", name, scenes, TEST if name == base else DRAW)
            for name, scenes in tests.items()
            if scenes
        ),
        rejected,
        identity,
    )


def _recorded(request: RunRequest, protocol: LoadedProtocol, parts: Parts) -> FramePlan:
    keys = protocol.keys
    sensor = parts.build_sensor(SensorContext(np.random.SeedSequence(0), request.data))
    if keys.recorded is None:
        raise UserError(_lacking(request, keys, sensor))
    if not isinstance(sensor, HasScenes):
        raise UserError(f"sensor {parts.sensor.name!r} does not say which presses it has.")
    scenes = sensor.scenes()
    names = list(scenes)
    describe = sensor.describe()
    published = protocol.test_frame_names()
    size = list(keys.recorded.test_frames_size or ())
    is_published = bool(published) and set(published) < set(names) and describe["image"] == size
    split = split_recorded(names, keys.recorded, keys.data_seed, published if is_published else None)
    identity = {"name": parts.sensor.name, "code": parts.sensor.code(), "describe": describe}

    def want(role: str, rows: Sequence[int]) -> Wanted:
        chosen = [names[i] for i in rows]
        key = digest({"sensor": identity, "frames": chosen})

        def read(advance: Advance) -> Presses:
            frames: list[Frame] = []
            for frame in sensor.press_many(scenes[name] for name in chosen):
                frames.append(frame)
                advance(1)
            picked = tuple(scenes[name] for name in chosen)
            return Presses(role, picked, frames, tuple(chosen), key)

        return Wanted(
            role,
            "recorded",
            tuple(scenes[name] for name in chosen),
            ("all",) * len(chosen),
            read,
            True,
            key,
        )

    fit, validation, test = split.fit, split.validation, split.test
    if request.quick:
        fit, validation = _spread(fit, QUICK_FIT), _spread(validation, QUICK_VALIDATION)
    limit = _test_limit(request)
    if limit is not None:
        test = _spread(test, limit)
    return FramePlan(
        (want("fit", fit),),
        (want("validation", validation),),
        (want("test", test),),
        0,
        identity,
    )


def _lacking(request: RunRequest, keys: Protocol, sensor: Sensor) -> str:
    have = "its own presses"
    if isinstance(sensor, HasScenes):
        kinds = sorted({scene.indenter.name.partition(" #")[0] for scene in sensor.scenes().values()})
        have = f"{len(sensor.scenes()):,} presses by {', '.join(kinds)}"
    lacks = sorted({draw.indenter for draw in keys.draws})
    return (
        f"{request.data} holds {have}, but protocol {keys.id!r} needs presses by spherical tips "
        f"({', '.join(lacks)}); run protocol 'surface' on it."
    )


def _group(keys: Protocol, draw: str, scene: Scene) -> str:
    if draw == keys.test.catch:
        return "catch"
    if keys.test.group == "distance":
        offsets = np.array(scene.indenter.offsets)
        return f"{float(np.linalg.norm(offsets[0] - offsets[-1])):.1f}"
    return scene.indenter.name if keys.test.group == "indenter" else "all"


def _test_limit(request: RunRequest) -> int | None:
    limits = [n for n in (request.limit, QUICK_TEST if request.quick else None) if n is not None]
    return min(limits, default=None)


def _thinned(tests: dict[str, list[Scene]], limit: int | None) -> dict[str, list[Scene]]:
    """At most ``limit`` presses of all sets together, evenly spread over them."""
    total = sum(len(scenes) for scenes in tests.values())
    if limit is None or limit >= total:
        return tests
    keep = set(_spread(range(total), limit))
    out, start = {}, 0
    for name, scenes in tests.items():
        out[name] = [scene for i, scene in enumerate(scenes, start) if i in keep]
        start += len(scenes)
    return out


def _spread(rows: Sequence[int], count: int) -> tuple[int, ...]:
    if count >= len(rows):
        return tuple(rows)
    return tuple(rows[int(i)] for i in (np.arange(count) + 0.5) * len(rows) / count)
