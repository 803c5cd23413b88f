"""Frames that somebody recorded, divided as a protocol says."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tactibench.errors import UserError
from tactibench.frames.drawn import thinned
from tactibench.frames.folder import Folder
from tactibench.frames.matching import Matched, match, needs
from tactibench.frames.presser import group_of
from tactibench.frames.source import (
    FramePlan,
    Wanted,
    fewer,
    scored_limit,
    sensor_identity,
    spread,
)
from tactibench.plugins.base import SensorContext
from tactibench.protocols.draws import pressable
from tactibench.protocols.loader import LoadedProtocol
from tactibench.protocols.schema import RECORDED, Protocol
from tactibench.protocols.split import split_recorded
from tactibench.run.components import Sensors
from tactibench.run.request import QUICK_FIT, QUICK_VALIDATION, RunRequest


def recorded_frames(request: RunRequest, protocol: LoadedProtocol, parts: Sensors) -> FramePlan:
    """Look the presses of a folder up and divide them. Raises UserError."""
    sensor = parts.build_sensor(SensorContext(np.random.SeedSequence(0), request.data))
    scenes = sensor.scenes()
    if scenes is None:
        raise UserError(
            f"sensor {parts.sensor.name!r} does not say which presses it has, which protocol "
            f"{protocol.keys.id!r} needs; use --sensor recorded."
        )
    folder = Folder.of(sensor, scenes, sensor_identity(parts.sensor, sensor.describe()))
    if protocol.keys.recorded is None:
        return _matched_frames(request, protocol.keys, parts, folder)
    folder = plates_of(request.data, protocol.keys, folder)
    published = None
    if folder.parts is None:
        image = folder.identity["describe"].get("image")
        published = published_split(protocol, folder.names, image)
    fit, validation, test = divided(protocol.keys, folder, published)
    return FramePlan(
        *training(request, folder, fit, validation),
        (folder.want("test", RECORDED, spread(test, scored_limit(request))),),
        0,
        folder.identity,
        published is not None and not request.partial,
    )


def training(
    request: RunRequest, folder: Folder, fit: Sequence[int], validation: Sequence[int]
) -> tuple[tuple[Wanted, ...], tuple[Wanted, ...]]:
    """What is learned from and what validates, of the rows that may. Raises UserError."""
    if request.presses is not None:  # evenly: a recording has an order
        fewer(fit, request)
        fit = spread(fit, request.presses)
    if request.quick:
        fit, validation = spread(fit, QUICK_FIT), spread(validation, QUICK_VALIDATION)
    return (
        (folder.want("fit", RECORDED, fit),),
        (folder.want("validation", RECORDED, validation),),
    )


def divided(
    keys: Protocol, folder: Folder, published: tuple[str, ...] | None = None
) -> tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]:
    """Rows that train, validate and test. Frames of one press are in one part. Raises UserError."""
    assert keys.recorded is not None  # noqa: S101 - the caller looked
    if folder.parts is not None:
        return own_parts(folder.parts, folder.presses)
    units = folder.names if published else tuple(dict.fromkeys(folder.presses))
    split = split_recorded(units, keys.recorded, keys.data_seed, published)
    if len(units) == len(folder.names):
        found = split.fit, split.validation, split.test
    else:
        rows: dict[str, list[int]] = {}
        for row, press in enumerate(folder.presses):
            rows.setdefault(press, []).append(row)
        fit, validation, test = (
            tuple(row for unit in part for row in rows[units[unit]])
            for part in (split.fit, split.validation, split.test)
        )
        found = fit, validation, test
    refuse_shared(folder.presses, found)
    return found


def own_parts(
    parts: Sequence[str], presses: Sequence[str]
) -> tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]:
    """Rows that train, validate and test, as the recording says of every frame. Raises UserError
    for a part without frames, and for a press in two parts."""
    fit, validation, test = (
        tuple(row for row, part in enumerate(parts) if part == name)
        for name in ("train", "validation", "test")
    )
    for name, rows in (("train", fit), ("validation", validation), ("test", test)):
        if not rows:
            raise UserError(
                f"the recording's split has no frames that this protocol can take in its part "
                f"{name!r}; give it some, or leave --param sensor.split out."
            )
    refuse_shared(presses, (fit, validation, test))
    return fit, validation, test


def plates_of(source: Path | None, keys: Protocol, folder: Folder) -> Folder:
    """The frames in which a plate pressed, for a protocol that asks for its pose."""
    if keys.answer != "plate":
        return folder
    plates = [row for row, scene in enumerate(folder.scenes) if scene.indenter.is_plate]
    if not plates:
        raise UserError(
            f"{source} holds {_kinds(folder)}, but protocol "
            f"{keys.id!r} needs presses by a plate; take another folder or another protocol."
        )
    return folder.take(plates)


def refuse_shared(presses: Sequence[str], parts: Sequence[Sequence[int]]) -> None:
    """Raises UserError when frames of one press are in two parts: the test would not be fair."""
    seen: dict[str, int] = {}
    for number, rows in enumerate(parts):
        for row in rows:
            if seen.setdefault(presses[row], number) != number:
                raise UserError(
                    f"frames of press {presses[row]!r} are in two parts of the split; a press "
                    "trains or tests, never both: divide the data set by press."
                )


def _matched_frames(
    request: RunRequest, keys: Protocol, parts: Sensors, folder: Folder
) -> FramePlan:
    """The presses that a protocol could have drawn. Raises UserError, saying what is lacking."""
    assert keys.split is not None  # noqa: S101 - a protocol that draws divides its draws
    pressed = pressable(keys, folder.sensor)
    found = match(pressed, keys.split, parts.regime, folder.scenes, folder.presses, folder.parts)
    if found.lacking:
        raise UserError(_lacking(request, pressed, folder, found))
    fit = {**found.fit, keys.split.draw: list(fewer(found.fit[keys.split.draw], request))}
    validation: Sequence[int] = found.validation[keys.split.draw]
    if request.quick:
        share = max(1, QUICK_FIT // len(fit))
        fit = {name: list(spread(rows, share)) for name, rows in fit.items()}
        validation = spread(validation, QUICK_VALIDATION)
    test = thinned(dict(found.test), scored_limit(request))
    return FramePlan(
        tuple(folder.want("fit", name, rows) for name, rows in fit.items()),
        (folder.want("validation", keys.split.draw, validation),),
        tuple(
            folder.want("test", name, rows, lambda scene, name=name: group_of(keys, name, scene))  # type: ignore[misc]
            for name, rows in test.items()
        ),
        found.left_out,
        folder.identity,
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


def _lacking(request: RunRequest, keys: Protocol, folder: Folder, found: Matched) -> str:
    space = keys.workspace
    lacks = "; ".join(f"{name}: {needs(keys.draw(name))}" for name in found.lacking)
    spheres = any(not scene.indenter.is_plate for scene in folder.scenes)
    do = "record those presses" if spheres else "run protocol 'surface' on it"
    return (
        f"{request.data} holds {_kinds(folder)}, but protocol "
        f"{keys.id!r} lacks presses by spherical tips to train, validate and test on "
        f"({lacks}; all with x, y within {space.half_width_mm:g} mm and "
        f"{space.depth_min_mm:g} to {space.depth_max_mm:g} mm deep); {do}."
    )


def _kinds(folder: Folder) -> str:
    """ "30 presses by plate" or "12 presses by dual, 40 by single"."""
    owned = {
        (scene.indenter.name.partition(" #")[0], press)
        for scene, press in zip(folder.scenes, folder.presses, strict=True)
    }
    kinds = sorted(Counter(kind for kind, _ in owned).items())
    texts = [f"{count:,} by {kind}" for kind, count in kinds]
    return ", ".join([texts[0].replace(" by ", " presses by ", 1), *texts[1:]])
