"""Frames that a sensor makes of the presses a protocol draws."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tactibench.contacts import Scene
from tactibench.datasets.generated import FrameRequest, folder_of, is_cached, open_frames
from tactibench.plugins.interfaces import SensorContext
from tactibench.protocols.draws import Drawn, draw_scenes
from tactibench.protocols.pressable import pressable
from tactibench.protocols.schema import Protocol, Split
from tactibench.protocols.split import split_presses
from tactibench.running.frames import (
    FramePlan,
    Wanted,
    fewer,
    scored_limit,
    sensor_identity,
    spread,
)
from tactibench.running.parts import Parts
from tactibench.running.request import QUICK_FIT, QUICK_VALIDATION, RunRequest

FIT, VALIDATION, TEST, WHOLE = 0, 1, 2, 3
"""Parts of a draw; the frames of each have noise of their own."""

Rows = dict[str, Sequence[int]]
"""Draw -> numbers of its presses."""


def drawn_frames(
    request: RunRequest, keys: Protocol, split: Split, parts: Parts, cache: Path
) -> FramePlan:
    """Draw the presses and divide them; frames are keyed, not made."""
    extra = keys.regimes[parts.regime]
    sensor = parts.build_sensor(SensorContext(np.random.SeedSequence(0)))
    pressed = pressable(keys, sensor)
    draws = {name: draw_scenes(pressed, name) for name in {split.draw, *extra, *keys.test.sets}}
    whole: Rows = {name: range(len(drawn.scenes)) for name, drawn in draws.items()}
    divided = split_presses(len(whole[split.draw]), split, keys.data_seed)

    fit: Rows = {split.draw: fewer(divided.fit, request), **{name: whole[name] for name in extra}}
    validation: Sequence[int] = divided.validation
    if request.quick:
        share = max(1, QUICK_FIT // len(fit))
        fit = {name: rows[:share] for name, rows in fit.items()}
        validation = validation[:QUICK_VALIDATION]
    test: Rows = {
        name: divided.test if name == split.draw else whole[name] for name in keys.test.sets
    }
    test = _thinned(test, scored_limit(request))

    identity = sensor_identity(parts, sensor.describe())
    radius = pressed.workspace.dome_radius_mm

    def want(role: str, name: str, rows: Sequence[int], part: int) -> Wanted:
        stream = keys.draw(name).stream
        frames = FrameRequest(
            name,
            parts.build_sensor,
            identity,
            tuple(draws[name].scenes[row] for row in rows),
            tuple(f"{name}-{row}" for row in rows),
            (keys.data_seed, stream, part if name == split.draw else WHOLE),
            None if radius == keys.workspace.dome_radius_mm else radius,
        )
        key = frames.key
        folder = folder_of(cache, key)
        groups = tuple(_group(keys, name, scene) for scene in frames.scenes)
        return Wanted(
            role,
            name,
            frames.scenes,
            groups,
            is_cached(folder),
            key,
            lambda advance: open_frames(frames, cache, advance),
        )

    return FramePlan(
        tuple(want("fit", name, rows, FIT) for name, rows in fit.items()),
        (want("validation", split.draw, validation, VALIDATION),),
        tuple(want("test", name, rows, TEST) for name, rows in test.items()),
        _rejected(draws, set(keys.test.sets) - {split.draw}),
        identity,
    )


def _rejected(draws: dict[str, Drawn], tested: set[str]) -> int:
    return sum(drawn.rejected for name, drawn in draws.items() if name in tested)


def _thinned(test: Rows, limit: int | None) -> Rows:
    """At most ``limit`` presses of all sets together, evenly spread over them."""
    kept = spread([(name, row) for name, rows in test.items() for row in rows], limit)
    thinned = {name: [row for of, row in kept if of == name] for name in test}
    return {name: rows for name, rows in thinned.items() if rows}


def _group(keys: Protocol, draw: str, scene: Scene) -> str:
    if draw == keys.test.catch:
        return "catch"
    if keys.test.group == "distance":
        offsets = np.array(scene.indenter.offsets)
        return str(round(float(np.linalg.norm(offsets[0] - offsets[-1])), 6))
    return scene.indenter.name if keys.test.group == "indenter" else "all"
