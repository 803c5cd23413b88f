"""Frames that somebody recorded, divided as a protocol says."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tactibench.contacts import Frame, Scene
from tactibench.errors import UserError
from tactibench.frames.matching import Match, describe_lacking, describe_range, match
from tactibench.frames.presses import Presses
from tactibench.frames.source import (
    FEW_SHOT,
    QUICK_FIT,
    QUICK_VALIDATION,
    Advance,
    FramePlan,
    FrameRequest,
    FrameSet,
    FrameSource,
    group_of,
    sensor_identity,
    spread,
    spread_over_sets,
)
from tactibench.plugins import Sensor, SensorContext, SensorSpec
from tactibench.protocols import (
    RECORDED,
    LoadedProtocol,
    PressSplit,
    Protocol,
    permutation,
    pressable,
    split_recorded,
)
from tactibench.records import BoundSpec, digest

Sets = tuple[FrameSet, ...]


@dataclass(frozen=True)
class Recording:
    """The frames of a recorded folder as a run reads them.

    Attributes:
        sensor: The sensor that reads the frames.
        identity: All that determines the frames.
        names: Name of every frame.
        scenes: Scene of every frame.
        presses: Press of every frame; frames of one press share it.
        parts: Part of every frame in the recording's own split, "" for none; None: it has no split.
        sessions: Session of every frame, "" where it is not known.
    """

    sensor: Sensor
    identity: dict[str, Any]
    names: tuple[str, ...]
    scenes: tuple[Scene, ...]
    presses: tuple[str, ...]
    parts: tuple[str, ...] | None = None
    sessions: tuple[str, ...] = ()

    @classmethod
    def open(
        cls,
        protocol: Protocol,
        component: BoundSpec[SensorSpec],
        folder: Path | None,
        *,
        indentation: bool = False,
    ) -> Recording:
        """Return the recording in a folder; for a protocol of plates, the plate presses alone.

        Args:
            protocol: Protocol whose presses are looked for.
            component: The sensor that reads the folder.
            folder: Folder of the recording.
            indentation: Whether depths must mean the same on every sensor.

        Raises:
            UserError: The sensor names no presses, or the protocol needs plates and none was
                pressed.
        """
        seed = np.random.SeedSequence(0)
        sensor: Sensor = component.build(SensorContext(seed, folder, indentation=indentation))
        scenes = sensor.scenes()
        if scenes is None:
            raise UserError(
                f"sensor {component.name!r} does not say which presses it has, which protocol "
                f"{protocol.id!r} needs; use --sensor recorded."
            )
        presses, split, sessions = sensor.presses(), sensor.split(), sensor.sessions()
        identity = sensor_identity(component, sensor.describe())

        def of(names: Iterable[str]) -> Recording:
            """Return the recording with some of its frames."""
            chosen = tuple(names)
            return cls(
                sensor,
                identity,
                chosen,
                tuple(scenes[name] for name in chosen),
                tuple(presses.get(name, name) for name in chosen),
                tuple(split.get(name, "") for name in chosen) if split else None,
                tuple(sessions.get(name, "") for name in chosen),
            )

        if protocol.answer != "plate":
            return of(scenes)
        plates = of(name for name, scene in scenes.items() if scene.indenter.is_plate)
        if not plates.names:
            raise UserError(
                f"{folder} holds {of(scenes).contents()}, but protocol {protocol.id!r} needs "
                "presses by a plate; take another folder or another protocol."
            )
        return plates

    def contents(self) -> str:
        """Return the presses in words, such as "12 presses by dual, 40 by single"."""
        owned = {
            (scene.indenter.name, press)
            for scene, press in zip(self.scenes, self.presses, strict=True)
        }
        kinds = sorted(Counter(kind for kind, _ in owned).items())
        texts = [f"{count:,} by {kind}" for kind, count in kinds]
        return ", ".join([texts[0].replace(" by ", " presses by ", 1), *texts[1:]])

    def frame_set(
        self,
        role: str,
        name: str,
        rows: Sequence[int],
        group: Callable[[Scene], str] = lambda _: "all",
    ) -> FrameSet:
        """Return the frames of some rows.

        Args:
            role: "fit", "validation", "test" or "few-shot".
            name: Name of the set.
            rows: Rows of the recording.
            group: Returns the group of a press in the result tables.
        """
        names = tuple(self.names[row] for row in rows)
        scenes = tuple(self.scenes[row] for row in rows)
        presses = tuple(self.presses[row] for row in rows)
        return RecordedFrameSet(
            role=role,
            name=name,
            scenes=scenes,
            groups=tuple(group(scene) for scene in scenes),
            names=names,
            presses=() if presses == names else presses,
            recording=self,
        )


@dataclass(frozen=True, kw_only=True)
class RecordedFrameSet(FrameSet):
    """Frames that are read from a folder when they are opened."""

    recording: Recording

    @property
    def key(self) -> str:
        """Return the identity of the recording and of the frames in it."""
        return digest({"sensor": self.recording.identity, "frames": self.names})

    @property
    def cached(self) -> bool:
        """Return True: nothing has to be made."""
        return True

    def open(self, advance: Advance) -> Presses:
        """Return the frames, read from the folder."""
        sensor = self.recording.sensor
        frames: list[Frame] = []
        with sensor:
            for frame in sensor.frames(self.names):
                frames.append(frame)
                advance(1)
        return Presses(
            self.name,
            self.scenes,
            frames,
            self.names,
            self.key,
            dome_radius=sensor.dome_radius_mm,
        )


class RecordedFrames(FrameSource):
    """The presses of a recording, all by one kind of indenter, divided by a share of them."""

    def __init__(self, request: FrameRequest) -> None:
        super().__init__(request)
        self.recording = Recording.open(self.spec, request.sensor, request.data)
        self._published = None
        if self.recording.parts is None:
            image = self.recording.identity["describe"].get("image")
            self._published = published_frames(request.protocol, self.recording.names, image)
        complete = not request.quick and request.limit is None
        self.published = self._published is not None and complete

    def plan(self) -> FramePlan:
        """Return the recorded presses of every role."""
        division = divide(self.spec, self.recording, self._published)
        fit, validation = training_sets(self.request, self.recording, division)
        return FramePlan(
            source=self,
            fit=fit,
            validation=validation,
            test=(self._test(division),),
            sensor_identity=self.recording.identity,
            signals=(self.recording.sensor.signal,),
        )

    def test_frames(self) -> tuple[FrameSet, ...]:
        """Return the test frames, or as many as the request asks for."""
        return (self._test(divide(self.spec, self.recording, self._published)),)

    def _test(self, division: PressSplit) -> FrameSet:
        rows = spread(division.test, self.request.test_count)
        return self.recording.frame_set("test", RECORDED, rows)


class MatchedFrames(FrameSource):
    """The presses of a recording that a protocol could have drawn.

    With another recording to test on, the test presses and labelled presses are those of that
    recording, divided alike: presses of one name, such as one place, never train and test.

    Raises:
        UserError: A recording lacks presses of a draw to train, validate or test on, or labelled
            presses that were asked for.
    """

    def __init__(self, request: FrameRequest) -> None:
        super().__init__(request)
        assert self.spec.split is not None  # noqa: S101 - a protocol that draws divides its draws
        self.split = self.spec.split
        self.recording, self.match = self._matched(request.sensor, request.data)
        self.workspace = self.recording.sensor.workspace
        self.tested, self.test_match = self.recording, self.match
        if request.test_data is not None:
            self.tested, self.test_match = self._matched(request.tested, request.test_data)
        self.tested_workspace = self.tested.sensor.workspace

    def _matched(
        self, sensor: BoundSpec[SensorSpec], folder: Path | None
    ) -> tuple[Recording, Match]:
        recording = Recording.open(self.spec, sensor, folder)
        pressed = pressable(self.spec, recording.sensor)
        regime, scenes, presses = self.request.regime, recording.scenes, recording.presses
        matched = match(pressed, self.split, regime, scenes, presses, recording.parts)
        if matched.lacking:
            raise UserError(_lacking(folder, pressed, recording, matched))
        return recording, matched

    def plan(self) -> FramePlan:
        """Return the matching presses of every role."""
        request, draw = self.request, self.split.draw
        fit: dict[str, Sequence[int]] = dict(self.match.fit)
        fit[draw] = fit[draw][: request.training_count(len(fit[draw]))]
        validation: Sequence[int] = self.match.validation[draw]
        if request.quick:
            share = max(1, QUICK_FIT // len(fit))
            fit = {name: spread(rows, share) for name, rows in fit.items()}
            validation = spread(validation, QUICK_VALIDATION)
        return FramePlan(
            source=self,
            fit=tuple(self.recording.frame_set("fit", *item) for item in fit.items()),
            validation=(self.recording.frame_set("validation", draw, validation),),
            test=self.test_frames(),
            few_shot=self._labelled_frames() if request.shots else None,
            rejected=self.test_match.left_out,
            sensor_identity=self.recording.identity,
            test_identity=None if request.test_data is None else self.tested.identity,
            signals=(self.recording.sensor.signal, self.tested.sensor.signal),
        )

    def test_frames(self) -> tuple[FrameSet, ...]:
        """Return the matching test presses, or as many as the request asks for."""
        rows = spread_over_sets(self.test_match.test, self.request.test_count)
        return tuple(
            self.tested.frame_set("test", name, chosen, partial(group_of, self.spec, name))
            for name, chosen in rows.items()
        )

    def _labelled_frames(self) -> FrameSet:
        pool, count = self.test_match.fit[self.split.draw], self.request.shots
        if count > len(pool):
            raise UserError(
                f"{self.request.test_data} has {len(pool):,} frames that are not tested on, but "
                f"--test shots={count} asks for more; ask for fewer."
            )
        order = permutation(len(pool), self.spec.data_seed)[:count]
        return self.tested.frame_set("few-shot", FEW_SHOT, [pool[row] for row in order.tolist()])


def recorded_source(request: FrameRequest) -> FrameSource:
    """Return the source for a protocol of recordings, or for one that draws its presses."""
    return MatchedFrames(request) if request.spec.recorded is None else RecordedFrames(request)


def training_sets(
    request: FrameRequest, recording: Recording, division: PressSplit
) -> tuple[Sets, Sets]:
    """Return the frame sets that train and those that validate.

    Raises:
        UserError: The request asks for as many training presses as there are, or more.
    """
    fit, validation = division.fit, division.validation
    if request.presses is not None:  # evenly: a recording has an order
        fit = spread(fit, request.training_count(len(fit)))
    if request.quick:
        fit, validation = spread(fit, QUICK_FIT), spread(validation, QUICK_VALIDATION)
    return (
        (recording.frame_set("fit", RECORDED, fit),),
        (recording.frame_set("validation", RECORDED, validation),),
    )


def divide(
    spec: Protocol, recording: Recording, published: tuple[str, ...] | None = None
) -> PressSplit:
    """Return the rows that train, validate and test; frames of one press are in one part.

    Args:
        spec: Protocol with the shares that test and validate.
        recording: The recording, which is divided by its own split where it has one.
        published: Names of published test frames, which are taken as they are.

    Raises:
        UserError: A part would have no frames, or a press is in two parts.
    """
    assert spec.recorded is not None  # noqa: S101 - the caller looked
    if recording.parts is not None:
        return divide_by_parts(recording.parts, recording.presses)
    rows: dict[str, list[int]] = {}
    for row, unit in enumerate(recording.names if published else recording.presses):
        rows.setdefault(unit, []).append(row)
    units = tuple(rows)
    split = split_recorded(units, spec.recorded, spec.data_seed, published)
    division = PressSplit(
        *(tuple(row for unit in part for row in rows[units[unit]]) for part in split)
    )
    refuse_shared_presses(recording.presses, division)
    return division


def divide_by_parts(parts: Sequence[str], presses: Sequence[str]) -> PressSplit:
    """Return the rows of the parts "train", "validation" and "test" of a recording's own split.

    Raises:
        UserError: A part has no frames, or a press is in two parts.
    """
    names = ("train", "validation", "test")
    division = PressSplit(
        *(tuple(row for row, part in enumerate(parts) if part == name) for name in names)
    )
    for name, rows in zip(names, division, strict=True):
        if not rows:
            raise UserError(
                f"the recording's split has no frames that this protocol can take in its part "
                f"{name!r}; give it some, or leave --param sensor.split out."
            )
    refuse_shared_presses(presses, division)
    return division


def published_frames(
    protocol: LoadedProtocol, names: Sequence[str], image: list[int] | None
) -> tuple[str, ...] | None:
    """Return the names of the published test frames; None where a recording is another one.

    The recording must hold all of them and more, at their size.

    Args:
        protocol: The protocol, which lists the published test frames.
        names: Names of the recording's frames.
        image: Height and width of its frames, px; None: not known.
    """
    published, recorded = protocol.test_frames, protocol.spec.recorded
    if not published or recorded is None or recorded.test_frames_size is None or image is None:
        return None
    same = set(published) < set(names) and tuple(image) == recorded.test_frames_size
    return published if same else None


def refuse_shared_presses(presses: Sequence[str], division: PressSplit) -> None:
    """Raise UserError when frames of one press are in two parts: the test would not be fair."""
    part_of: dict[str, int] = {}
    for number, rows in enumerate(division):
        for row in rows:
            if part_of.setdefault(presses[row], number) != number:
                raise UserError(
                    f"frames of press {presses[row]!r} are in two parts of the split; a press "
                    "trains or tests, never both: divide the data set by press."
                )


def _lacking(folder: Path | None, spec: Protocol, recording: Recording, matched: Match) -> str:
    tips = [scene for scene in recording.scenes if not scene.indenter.is_plate]
    named = any(scene.sites is not None for scene in recording.scenes)
    remedy = f"run protocol {'sites' if named else 'surface'!r} on it"
    if tips and not named:
        remedy = (
            f"the recorded ones have {describe_range(tips)}: record others, or import again with "
            "the zeros that are right (x_zero_mm, y_zero_mm, offset_mm of the depth)"
        )
    return (
        f"{folder} holds {recording.contents()}, but protocol "
        f"{spec.id!r} lacks presses by spherical tips to train, validate and test on "
        f"({describe_lacking(spec, matched.lacking)}); {remedy}."
    )
