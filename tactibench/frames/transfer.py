"""Frames of two sensors: one trains, the other gives some labelled frames and is tested."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactibench.errors import UserError
from tactibench.frames.drawn import FIT, VALIDATION
from tactibench.frames.folder import Folder
from tactibench.frames.presser import Presser
from tactibench.frames.recorded import divided, plates_of, training
from tactibench.frames.source import (
    FramePlan,
    Wanted,
    fewer,
    scored_limit,
    sensor_identity,
    spread,
)
from tactibench.plugins.base import SensorContext
from tactibench.plugins.specs import SensorSpec
from tactibench.protocols.draws import draw_plates, draw_shots
from tactibench.protocols.loader import LoadedProtocol
from tactibench.protocols.schema import RECORDED, Protocol, Transfer
from tactibench.run.components import Part, Sensors
from tactibench.run.request import QUICK_FIT, QUICK_VALIDATION, RunRequest

PLATES, SHOTS = "plates", "shots"


@dataclass(frozen=True)
class Target:
    """The recording that is tested. test: its test part. left: rows that may be shown with labels.

    calibrated: frames to which a simulated sensor was fitted; they are in neither.
    """

    folder: Folder
    test: list[int]
    left: list[int]
    calibrated: int

    def want(self, limit: int | None) -> Wanted:
        """Its test frames, or ``limit`` of them."""
        return self.folder.want("test", RECORDED, spread(self.test, limit))


def open_target(
    keys: Protocol, parts: Sensors, path: Path | None, source: Presser | None
) -> Target:
    """The tested recording of ``parts``, divided. source: what presses the training frames, None
    where they are recorded too. Raises UserError."""
    folder = _folder(keys, parts.test_sensor, path)
    pool, _, test = divided(keys, folder)
    used = frozenset[str]() if source is None else _calibrated(source, folder)
    tested, left = ([row for row in rows if folder.names[row] not in used] for rows in (test, pool))
    return Target(folder, tested, left, len(used))


def transfer_frames(
    request: RunRequest, protocol: LoadedProtocol, transfer: Transfer, parts: Sensors, cache: Path
) -> FramePlan:
    """Training frames of one sensor; of the other its test part, and shots from its training part.

    Frames to which a simulated sensor was fitted are neither. Raises UserError.
    """
    keys = protocol.keys
    if parts.sensor.spec.needs_data:
        target = open_target(keys, parts, request.tested.data, None)
        source = _folder(keys, parts.sensor, request.data)
        fit, validation, _ = divided(keys, source)
        learned = training(request, source, fit, validation)
        identity = source.identity
    else:
        presser = Presser(keys, parts.sensor, parts.build_sensor, cache)
        target = open_target(keys, parts, request.tested.data, presser)
        learned = _pressed(request, keys, presser)
        identity = presser.identity
    shots = [target.left[number] for number in draw_shots(keys, len(target.left))]
    if len(shots) < max(transfer.shots):
        raise UserError(
            f"{request.tested.data} leaves {len(target.left):,} presses besides its test part, but "
            f"protocol {keys.id!r} gives a model up to {max(transfer.shots)} labelled ones; record "
            "more presses."
        )
    return FramePlan(
        *learned,
        (target.want(scored_limit(request)),),
        0,
        identity,
        tested_identity=target.folder.identity,
        shots=target.folder.want("shots", SHOTS, shots),
        calibrated=target.calibrated,
    )


def _folder(keys: Protocol, sensor: Part[SensorSpec], path: Path | None) -> Folder:
    """The plate presses of a recording. Raises UserError."""
    context = SensorContext(np.random.SeedSequence(0), path, indentation=True)
    opened = sensor.spec.load()(context, **sensor.values)
    scenes = opened.scenes()
    if scenes is None:
        raise UserError(
            f"sensor {sensor.name!r} does not say which presses it has, which protocol "
            f"{keys.id!r} needs; use --sensor recorded."
        )
    identity = sensor_identity(sensor, opened.describe())
    return plates_of(path, keys, Folder.of(opened, scenes, identity))


def _pressed(
    request: RunRequest, keys: Protocol, presser: Presser
) -> tuple[tuple[Wanted, ...], tuple[Wanted, ...]]:
    """Plate presses that the sensor makes, each drawn on its own: the last ones validate."""
    assert keys.plates is not None  # noqa: S101 - the caller looked
    assert keys.recorded is not None  # noqa: S101 - with [transfer] it is there
    scenes = draw_plates(presser.pressed, keys.plates).scenes
    end = len(scenes) - round(keys.recorded.validation_share * len(scenes))
    fit, validation = fewer(range(end), request), range(end, len(scenes))
    if request.quick:
        fit, validation = fit[:QUICK_FIT], validation[:QUICK_VALIDATION]
    stream = keys.plates.stream

    def want(role: str, rows: Sequence[int], part: int) -> Wanted:
        chosen, names = [scenes[row] for row in rows], [f"{PLATES}-{row}" for row in rows]
        return presser.want(role, PLATES, chosen, names, part, stream=stream)

    return (want("fit", fit, FIT),), (want("validation", validation, VALIDATION),)


def _calibrated(presser: Presser, target: Folder) -> frozenset[str]:
    """Names of the target's frames to which the simulated sensor was fitted."""
    digest = target.identity["describe"].get("sha256", "")
    return frozenset(presser.sensor.calibrated_on().get(digest, ())) & frozenset(target.names)
