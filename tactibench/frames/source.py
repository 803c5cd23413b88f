"""Sources of the frames of a run, their requests and the sets that they plan.

A source plans all sets of frames from a request without making a frame. There is one class for each
source: drawn presses, reference scenes, hard cases, a recording, and another sensor's recording.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from tactibench.contacts import Scene, Workspace
from tactibench.errors import UserError
from tactibench.frames.presses import Presses
from tactibench.plugins import Sensor, SensorSpec
from tactibench.protocols import SAME_MM, LoadedProtocol, Protocol, in_range
from tactibench.records import BoundSpec, combined

if TYPE_CHECKING:
    from tactibench.protocols import HiddenSeed

FEW_SHOT = "shots"
"""Name of the set of labelled frames of the tested sensor."""
QUICK_FIT, QUICK_VALIDATION, QUICK_TEST = 200, 40, 40
"""Presses of a ``--quick`` run: it proves the path in under a minute, nothing else."""

Advance = Callable[[int], None]
"""Called with the number of frames that were finished."""

Row = TypeVar("Row")


@dataclass(frozen=True, kw_only=True)
class FrameRequest:
    """The demands of a run on its frames.

    Attributes:
        protocol: Protocol whose presses are trained and tested on.
        regime: Name of the protocol's training regime.
        sensor: Sensor that presses the training scenes.
        test_sensor: Sensor that presses the test scenes; None where the same sensor does.
        cache: Folder in which generated frames are kept.
        data: Recording of the training sensor, for a sensor that reads one.
        test_data: Recording of the tested sensor, for a protocol that changes the sensor.
        reference: Whether the sensor's reference scenes are tested on.
        hidden: Seed of test presses that is kept secret.
        quick: Whether a few presses are enough, to prove the path.
        limit: Largest number of test presses; None: all.
        presses: Number of presses to learn from; None: all.
        shots: Number of labelled single presses of the tested sensor that are shown before the
            test.
    """

    protocol: LoadedProtocol
    regime: str
    sensor: BoundSpec[SensorSpec]
    test_sensor: BoundSpec[SensorSpec] | None = None
    cache: Path
    data: Path | None = None
    test_data: Path | None = None
    reference: bool = False
    hidden: HiddenSeed | None = None
    quick: bool = False
    limit: int | None = None
    presses: int | None = None
    shots: int = 0

    @property
    def spec(self) -> Protocol:
        """Return the validated protocol."""
        return self.protocol.spec

    @property
    def tested(self) -> BoundSpec[SensorSpec]:
        """Return the sensor that presses the test scenes."""
        return self.test_sensor or self.sensor

    @property
    def test_count(self) -> int | None:
        """Return the largest number of test presses; None: all."""
        limits = [self.limit, QUICK_TEST if self.quick else None]
        return min((limit for limit in limits if limit is not None), default=None)

    def training_count(self, available: int) -> int:
        """Return how many of the available presses are learned from.

        Raises:
            UserError: ``--presses`` names as many presses as there are, or more.
        """
        if self.presses is None:
            return available
        if self.presses >= available:
            raise UserError(
                f"--presses is {self.presses:,}, but must be less than the {available:,} presses "
                "that there are to learn from; leave the option out to take them all."
            )
        return self.presses


@dataclass(frozen=True, kw_only=True)
class FrameSet(ABC):
    """One set of frames that a run needs: known before a frame is made.

    Attributes:
        role: "fit", "validation", "test" or "few-shot".
        name: Name of the draw, family or recording.
        scenes: Scene of every frame.
        groups: Group of every frame in the result tables.
        names: Name of every frame, unique in the set.
        presses: Press that every frame belongs to; empty where each is a press of its own.
        apart: Whether they are scored apart from the other test frames, which come before them.
    """

    role: str
    name: str
    scenes: tuple[Scene, ...]
    groups: tuple[str, ...]
    names: tuple[str, ...]
    presses: tuple[str, ...] = ()
    apart: bool = False

    @property
    @abstractmethod
    def key(self) -> str:
        """Return the identity of the frames, known before they are made."""

    @property
    @abstractmethod
    def cached(self) -> bool:
        """Return whether the frames exist already."""

    def remove(self) -> None:  # noqa: B027 - frames that are read from a folder stay there
        """Remove generated frames from the cache, so that they are made anew."""

    @abstractmethod
    def open(self, advance: Advance) -> Presses:
        """Return the frames, made or read.

        Raises:
            UserError: The sensor cannot make the frames, or a file cannot be read.
        """

    def open_sensor(self) -> Sensor | None:
        """Return the sensor that makes the frames, not to be pressed; None for recorded frames."""
        return None

    @property
    def clusters(self) -> tuple[str, ...]:
        """Return the press that every frame belongs to."""
        return self.presses or self.names


@dataclass(frozen=True, kw_only=True)
class FramePlan:
    """The frames of a run.

    Attributes:
        source: Source of the frames.
        fit: Sets of frames that train.
        validation: Sets of frames that validate.
        test: Sets of frames that test.
        few_shot: Labelled frames of the tested sensor, in the order in which they are shown.
        sensor_identity: All that determines the training frames but the seed.
        test_identity: The same of the tested sensor; None where it is the same sensor.
        rejected: Number of candidates that did not fit the workspace in the test draws; of a
            recording, the number of frames that belong to no draw.
        workspace: Range of the training sensor, where it is not the protocol's.
        signals: Kinds of signal of the training and of the tested sensor, see ``Sensor.signal``.
        folds: Divisions of the frames that are trained and tested one after the other, in the order
            of the test sets; () where the weights of one training answer all test frames.
        calibrated: Number of frames that test nothing because a simulator was fitted to them.
    """

    source: FrameSource = field(repr=False)
    fit: tuple[FrameSet, ...]
    validation: tuple[FrameSet, ...]
    test: tuple[FrameSet, ...]
    few_shot: FrameSet | None = None
    sensor_identity: dict[str, Any]
    signals: tuple[str, ...]
    test_identity: dict[str, Any] | None = None
    rejected: int = 0
    folds: tuple[FramePlan, ...] = ()
    calibrated: int = 0

    def __iter__(self) -> Iterator[FrameSet]:
        return iter((*self.fit, *self.validation, *self.test))

    def count(self, role: str) -> int:
        """Return how many frames have a role."""
        return sum(len(frames.scenes) for frames in self if frames.role == role)

    @property
    def knows_depth(self) -> bool:
        """Return whether the depth of every press is known."""
        return not any(math.isnan(scene.pose.depth) for frames in self for scene in frames.scenes)

    def training_key(self) -> str:
        """Return the identity of the frames that a model learns from."""
        return combined([f"{frames.role} {frames.key}" for frames in (*self.fit, *self.validation)])


class FrameSource(ABC):
    """A place that frames come from.

    Attributes:
        simulates: Whether more is known of the test frames than their labels: true surfaces,
            smallest possible errors, and how the sensor made its scenes.
        published: Whether the test frames are those of a publication, so that its numbers may be
            compared frame for frame.
        workspace: Range of the training sensor; None where it is the protocol's.
        tested_workspace: Range of the tested sensor, likewise.
    """

    simulates: bool = False
    published: bool = False
    workspace: Workspace | None = None
    tested_workspace: Workspace | None = None

    def __init__(self, request: FrameRequest) -> None:
        self.request = request
        self.spec = request.spec

    def on_range(self) -> Protocol:
        """Return the protocol in the range of the training sensor."""
        return self.spec if self.workspace is None else in_range(self.spec, self.workspace)

    @property
    def gate_mm(self) -> float:
        """Gate of the test, which grows with the range of the tested sensor, mm."""
        space = self.tested_workspace
        return (self.spec if space is None else in_range(self.spec, space)).test.gate_mm

    @abstractmethod
    def plan(self) -> FramePlan:
        """Return all sets of frames; no frame is made.

        Raises:
            UserError: The sensor or the recording does not have the frames that are asked for.
        """

    @abstractmethod
    def test_frames(self) -> tuple[FrameSet, ...]:
        """Return the test sets alone, which a verification makes again.

        Raises:
            UserError: The sensor or the recording does not have the frames that are asked for.
        """


def sensor_identity(sensor: BoundSpec[SensorSpec], description: dict[str, Any]) -> dict[str, Any]:
    """Return all of a sensor that determines its frames, but the seed."""
    checks = {p.name: p.default for p in sensor.spec.parameters if p.checks_only}
    values = {k: v for k, v in sensor.values.items() if k not in checks or v != checks[k]}
    return {
        "name": sensor.name,
        "parameters": values,
        "code": sensor.code(),
        "describe": description,
    }


def spread(rows: Sequence[Row], count: int | None) -> tuple[Row, ...]:
    """Return at most ``count`` rows, evenly spread over all; None: all of them."""
    if count is None or count >= len(rows):
        return tuple(rows)
    return tuple(rows[(2 * i + 1) * len(rows) // (2 * count)] for i in range(count))


def spread_over_sets(
    rows_by_set: Mapping[str, Sequence[int]], count: int | None
) -> dict[str, list[int]]:
    """Return at most ``count`` rows of all sets together, evenly spread over them.

    Sets without a row in the result are left out.

    Args:
        rows_by_set: Name of a set -> its rows.
        count: Largest number of rows; None: all of them.
    """
    pairs = [(name, row) for name, rows in rows_by_set.items() for row in rows]
    chosen: dict[str, list[int]] = {}
    for name, row in spread(pairs, count):
        chosen.setdefault(name, []).append(row)
    return chosen


def group_of(spec: Protocol, draw: str, scene: Scene) -> str:
    """Return the group of a drawn press in the result tables."""
    if draw == spec.test.catch:
        return "catch"
    if spec.test.group == "distance":
        tips = np.array(scene.indenter.offsets)[:, :2]
        distance = float(np.linalg.norm(tips[0] - tips[-1]))
        drawn = spec.draw(draw).distances_mm
        near = (other for other in drawn if abs(other - distance) < SAME_MM)
        return str(next(near, round(distance, 6)))
    if spec.test.group == "indenter" and spec.draw(draw).offsets_mm:
        return draw  # recordings call any such holder "tips"
    kind = scene.indenter.name
    return kind if spec.test.group == "indenter" else "all"


def frame_source(request: FrameRequest) -> FrameSource:
    """Return the source that a request asks for.

    Raises:
        UserError: The sensor does not have the frames that the protocol asks for.
    """
    spec = request.spec
    if spec.transfer is not None:
        from tactibench.frames.transfer import TransferFrames

        return TransferFrames(request)
    if spec.sites is not None:
        from tactibench.frames.sites import SiteFrames

        return SiteFrames(request)
    if request.sensor.spec.needs_data:
        from tactibench.frames.recorded import recorded_source

        return recorded_source(request)
    if spec.families:
        from tactibench.frames.hard_cases import HardCaseFrames

        return HardCaseFrames(request)
    if request.reference:
        from tactibench.frames.drawn_presses import ReferenceFrames

        return ReferenceFrames(request)
    from tactibench.frames.drawn_presses import DrawnFrames

    return DrawnFrames(request)
