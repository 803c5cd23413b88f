"""Which frames a run trains on, validates on and is tested on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from tactibench.contacts import Scene
from tactibench.errors import UserError
from tactibench.frames.presses import Presses
from tactibench.plugins.specs import SensorSpec
from tactibench.protocols.hidden_seed import HiddenSeed
from tactibench.protocols.loader import LoadedProtocol
from tactibench.records.identity import combined
from tactibench.run.components import Part, Sensors
from tactibench.run.request import QUICK_TEST, RunRequest

Advance = Callable[[int], None]
Row = TypeVar("Row")


@dataclass(frozen=True)
class Wanted:
    """One set of presses that a run needs.

    role: "fit", "validation" or "test". groups: of every press, in the result tables. cached:
    whether the frames are there already. key: identity of the frames, known before they are made.
    presses: of every frame, the press that it belongs to; (): each is one of its own. names: of
    every frame.
    """

    role: str
    name: str
    scenes: tuple[Scene, ...]
    groups: tuple[str, ...]
    cached: bool
    key: str
    open: Callable[[Advance], Presses] = field(repr=False)
    presses: tuple[str, ...] = ()
    names: tuple[str, ...] = ()

    @property
    def clusters(self) -> tuple[str, ...]:
        """Of every frame, its press."""
        return self.presses or self.names


@dataclass(frozen=True)
class FramePlan:
    """The frames of a run.

    rejected: candidates that geometry refused in the test draws. published: whether the test
    frames are those of a publication, so that its numbers may be compared frame for frame.
    tested_identity: of what presses the test scenes, where it is not the sensor. shots: labelled
    frames of the tested sensor, in the order in which they are given; None: none are. calibrated:
    how many of its frames nobody is tested on, because a simulator was fitted to them.
    """

    fit: tuple[Wanted, ...]
    validation: tuple[Wanted, ...]
    test: tuple[Wanted, ...]
    rejected: int
    sensor_identity: dict[str, Any]
    published: bool = False
    tested_identity: dict[str, Any] | None = None
    shots: Wanted | None = None
    calibrated: int = 0

    def __iter__(self) -> Iterator[Wanted]:
        return iter((*self.fit, *self.validation, *self.test))

    def count(self, role: str) -> int:
        return sum(len(wanted.scenes) for wanted in self if wanted.role == role)

    def training_key(self) -> str:
        """Identity of what is handed to ``fit``."""
        return combined([f"{w.role} {w.key}" for w in (*self.fit, *self.validation)])


def plan_frames(
    request: RunRequest,
    protocol: LoadedProtocol,
    parts: Sensors,
    cache: Path,
    hidden: HiddenSeed | None = None,
) -> FramePlan:
    """Draw or look up all scenes; no frame is made yet. hidden: what the test presses are drawn
    from. Raises UserError."""
    from tactibench.frames.drawn import drawn_frames
    from tactibench.frames.recorded import recorded_frames

    if protocol.keys.transfer is not None:
        from tactibench.frames.transfer import transfer_frames

        return transfer_frames(request, protocol, protocol.keys.transfer, parts, cache)
    if parts.sensor.spec.needs_data and protocol.keys.families:
        raise UserError(
            f"protocol {protocol.keys.id!r} presses hard cases, which the folder of sensor "
            f"{parts.sensor.name!r} does not hold; take a simulated sensor."
        )
    if parts.sensor.spec.needs_data:
        return recorded_frames(request, protocol, parts)
    if protocol.keys.split is None:
        raise UserError(
            f"protocol {protocol.keys.id!r} takes the presses of a recorded folder, which sensor "
            f"{parts.sensor.name!r} does not have; use --sensor recorded --data DIR."
        )
    return drawn_frames(request, protocol.keys, protocol.keys.split, parts, cache, hidden)


def sensor_identity(sensor: Part[SensorSpec], describe: dict[str, Any]) -> dict[str, Any]:
    """All of a sensor that determines its frames, but the seed."""
    return {
        "name": sensor.name,
        "parameters": dict(sensor.values),
        "code": sensor.code(),
        "describe": describe,
    }


def scored_limit(request: RunRequest) -> int | None:
    """At most how many test presses are scored; None: all."""
    limits = [n for n in (request.limit, QUICK_TEST if request.quick else None) if n is not None]
    return min(limits, default=None)


def fewer(rows: Sequence[Row], request: RunRequest) -> tuple[Row, ...]:
    """The first ``--presses`` rows to learn from, or all. Raises UserError for too many."""
    count = request.presses
    if count is not None and count >= len(rows):
        raise UserError(
            f"--presses is {count:,}, but must be less than the {len(rows):,} presses that there "
            "are to learn from; leave the option out to take them all."
        )
    return tuple(rows[:count])


def spread(rows: Sequence[Row], count: int | None) -> tuple[Row, ...]:
    """At most ``count`` rows, evenly spread over all."""
    if count is None or count >= len(rows):
        return tuple(rows)
    return tuple(rows[(2 * i + 1) * len(rows) // (2 * count)] for i in range(count))
