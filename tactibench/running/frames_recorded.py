"""Frames that somebody recorded, divided as a protocol says."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactibench.contacts import Frame
from tactibench.datasets.presses import Presses
from tactibench.errors import UserError
from tactibench.plugins.interfaces import HasScenes, Sensor, SensorContext
from tactibench.protocols.loader import LoadedProtocol
from tactibench.protocols.schema import RECORDED, Protocol
from tactibench.protocols.split import split_recorded
from tactibench.records.identity import digest
from tactibench.running.frames import (
    Advance,
    FramePlan,
    Wanted,
    fewer,
    scored_limit,
    sensor_identity,
    spread,
)
from tactibench.running.parts import Parts
from tactibench.running.request import QUICK_FIT, QUICK_VALIDATION, RunRequest


def recorded_frames(request: RunRequest, protocol: LoadedProtocol, parts: Parts) -> FramePlan:
    """Look the presses of a folder up and divide them. Raises UserError."""
    keys = protocol.keys
    sensor = parts.build_sensor(SensorContext(np.random.SeedSequence(0), request.data))
    if keys.recorded is None:
        raise UserError(_lacking(request, keys, sensor))
    if not isinstance(sensor, HasScenes):
        raise UserError(
            f"sensor {parts.sensor.name!r} does not say which presses it has, which protocol "
            f"{keys.id!r} needs; use --sensor recorded."
        )
    scenes = sensor.scenes()
    names = list(scenes)
    identity = sensor_identity(parts, sensor.describe())
    published = published_split(protocol, names, identity["describe"].get("image"))
    split = split_recorded(names, keys.recorded, keys.data_seed, published)

    def want(role: str, rows: Sequence[int]) -> Wanted:
        chosen = tuple(names[row] for row in rows)
        picked = tuple(scenes[name] for name in chosen)
        key = digest({"sensor": identity, "frames": chosen})

        def read(advance: Advance) -> Presses:
            frames: list[Frame] = []
            with sensor:
                for frame in sensor.press_many(picked):
                    frames.append(frame)
                    advance(1)
            return Presses(RECORDED, picked, frames, chosen, key)

        return Wanted(role, RECORDED, picked, ("all",) * len(chosen), True, key, read)

    fit, validation = split.fit, split.validation
    if request.presses is not None:  # evenly: a recording has an order
        fewer(fit, request)
        fit = spread(fit, request.presses)
    if request.quick:
        fit, validation = spread(fit, QUICK_FIT), spread(validation, QUICK_VALIDATION)
    return FramePlan(
        (want("fit", fit),),
        (want("validation", validation),),
        (want("test", spread(split.test, scored_limit(request))),),
        0,
        identity,
        published is not None and not request.partial,
    )


def published_split(
    protocol: LoadedProtocol, names: Sequence[str], image: list[int] | None
) -> tuple[str, ...] | None:
    """The published test frames, where a folder has them all, more, and at their size."""
    listed, keys = protocol.test_frames, protocol.keys.recorded
    if not listed or keys is None or keys.test_frames_size is None or image is None:
        return None
    same = set(listed) < set(names) and tuple(image) == keys.test_frames_size
    return listed if same else None


def _lacking(request: RunRequest, keys: Protocol, sensor: Sensor) -> str:
    have = "its own presses"
    if isinstance(sensor, HasScenes):
        scenes = sensor.scenes().values()
        kinds = sorted({scene.indenter.name.partition(" #")[0] for scene in scenes})
        have = f"{len(scenes):,} presses by {', '.join(kinds)}"
    lacks = sorted({draw.indenter for draw in keys.draws})
    return (
        f"{request.data} holds {have}, but protocol {keys.id!r} needs presses by spherical tips "
        f"({', '.join(lacks)}); run protocol 'surface' on it."
    )
