"""Frames that a sensor makes of the presses that a protocol draws, or of its reference scenes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from tactibench.contacts import Scene
from tactibench.errors import UserError
from tactibench.frames.cache import GeneratedFrameSet
from tactibench.frames.source import (
    FEW_SHOT,
    QUICK_FIT,
    QUICK_VALIDATION,
    FramePlan,
    FrameRequest,
    FrameSet,
    FrameSource,
    group_of,
    sensor_identity,
    spread,
    spread_over_sets,
)
from tactibench.plugins import INSTANCE, NOMINAL, Sensor, SensorContext, SensorSpec, Value
from tactibench.protocols import (
    FIT,
    LABELLED_STREAM,
    TEST,
    VALIDATION,
    WHOLE,
    ApartTest,
    Draw,
    Protocol,
    SceneSet,
    Split,
    draw_labelled,
    draw_scenes,
    fits,
    pressable,
    split_presses,
    subgroup,
)
from tactibench.records import BoundSpec

Rows = dict[str, Sequence[int]]
"""Draw -> numbers of its presses."""
FIRST_INSTANCE = 100
"""Number of the part of a draw that the first instance presses; ``protocols.split`` has others."""
REFERENCE_PART = 4
"""Number of the part of a draw, whose frames have noise of their own: not used by
``protocols.split``."""


@dataclass(frozen=True)
class SensorFrames:
    """A sensor that makes the frames of a protocol's scenes.

    Attributes:
        protocol: Protocol whose scenes are pressed.
        component: The sensor.
        cache: Folder in which frames are kept.
        secret: Whether the protocol's data seed must not be written down.
    """

    protocol: Protocol
    component: BoundSpec[SensorSpec]
    cache: Path
    secret: bool = False

    @cached_property
    def sensor(self) -> Sensor:
        """Return the sensor, to be asked and not to be pressed."""
        return self.open(np.random.SeedSequence(0))

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Return all that determines the frames but the seed."""
        return sensor_identity(self.component, self.sensor.describe())

    @cached_property
    def pressed(self) -> Protocol:
        """Return the protocol on the sensor's own surface."""
        return pressable(self.protocol, self.sensor)

    def open(self, seed: np.random.SeedSequence) -> Sensor:
        """Return a sensor with this seed."""
        sensor: Sensor = self.component.build(SensorContext(seed))
        return sensor

    def with_values(self, **values: Value) -> SensorFrames:
        """Return the frames of a sensor with other parameters, pressed as this one."""
        component = self.component
        changed = BoundSpec(component.spec, {**component.values, **values}, component.origin)
        return replace(self, component=changed)

    def draw(self, name: str) -> SceneSet:
        """Return the scenes of one of the protocol's draws on the sensor's surface."""
        return draw_scenes(self.pressed, name)

    def frame_set(
        self,
        role: str,
        name: str,
        scenes: Sequence[Scene],
        names: Sequence[str],
        part: int,
        *,
        stream: int | None = None,
        presses: Sequence[str] = (),
        groups: Sequence[str] | None = None,
        apart: bool = False,
    ) -> GeneratedFrameSet:
        """Return the frames of scenes, to be made when they are opened.

        Args:
            role: "fit", "validation", "test" or "few-shot".
            name: Name of the draw or family.
            scenes: Scene of every frame.
            names: Name of every frame, unique in the set.
            part: Number of the part of a draw; the frames of every part have noise of their own.
            stream: Random stream of that noise; None: the draw's.
            presses: Press of every frame; empty where each is a press of its own.
            groups: Group of every frame in the result tables; None: those of the draw.
            apart: Whether the frames are scored apart from the other test frames.
        """
        radius = self.pressed.workspace.dome_radius_mm
        if groups is None:
            groups = [group_of(self.protocol, name, scene) for scene in scenes]
        return GeneratedFrameSet(
            role=role,
            name=name,
            scenes=tuple(scenes),
            groups=tuple(groups),
            names=tuple(names),
            presses=tuple(presses),
            apart=apart,
            build=self.component.build,
            identity=self.identity,
            seed=(self.protocol.data_seed, stream or self.protocol.draw(name).stream, part),
            cache=self.cache,
            dome_radius=None if radius == self.protocol.workspace.dome_radius_mm else radius,
            secret=self.secret,
        )


class DrawnFrames(FrameSource):
    """Presses that a protocol draws and divides.

    One sensor makes the training frames, the same or another one the test frames.
    """

    simulates = True

    def __init__(self, request: FrameRequest) -> None:
        super().__init__(request)
        assert self.spec.split is not None  # noqa: S101 - a protocol that draws divides its draws
        self.split: Split = self.spec.split
        self.training = SensorFrames(self.spec, request.sensor, request.cache)
        self.workspace = self.training.sensor.workspace
        self.testing = self.training
        tested, hidden = self.spec, request.hidden
        if hidden is not None:
            tested = hidden.redraw(tested)
        if hidden is not None or request.test_sensor is not None:
            self.testing = SensorFrames(tested, request.tested, request.cache, hidden is not None)
        self.tested_workspace = self.testing.sensor.workspace

    def plan(self) -> FramePlan:
        """Return the drawn presses of every role."""
        request, split = self.request, self.split
        extra = self.spec.regimes[request.regime]
        draws = {name: self.training.draw(name) for name in {split.draw, *extra}}
        divided = split_presses(len(draws[split.draw].scenes), split, self.spec.data_seed)
        fit: Rows = {
            split.draw: divided.fit[: request.training_count(len(divided.fit))],
            **{name: range(len(draws[name].scenes)) for name in extra},
        }
        validation: Sequence[int] = divided.validation
        if request.quick:
            share = max(1, QUICK_FIT // len(fit))
            fit = {name: rows[:share] for name, rows in fit.items()}
            validation = validation[:QUICK_VALIDATION]
        return FramePlan(
            source=self,
            fit=tuple(
                self._frame_set(self.training, "fit", name, rows, self._part(name, FIT))
                for name, rows in fit.items()
            ),
            validation=(
                self._frame_set(self.training, "validation", split.draw, validation, VALIDATION),
            ),
            test=self.test_frames(),
            few_shot=self._labelled_frames() if request.shots else None,
            rejected=self.rejected(),
            sensor_identity=self.training.identity,
            signals=(self.training.sensor.signal, self.testing.sensor.signal),
            test_identity=None if request.test_sensor is None else self.testing.identity,
        )

    def test_frames(self) -> tuple[FrameSet, ...]:
        """Return the presses that the protocol tests, or as many as the request asks for.

        Presses that are scored apart come last; a test of a few presses has none of them.
        """
        rows: Rows = {
            name: range(len(self.testing.draw(name).scenes)) for name in self.spec.test.sets
        }
        if (split := self.split).draw in rows:
            count, seed = len(rows[split.draw]), self.testing.protocol.data_seed
            rows[split.draw] = split_presses(count, split, seed).test
        sets = [
            self._frame_set(self.testing, "test", name, chosen, self._part(name, TEST))
            for name, chosen in spread_over_sets(rows, self.request.test_count).items()
        ]
        if self.request.test_count is None:
            tests = zip(self.spec.test.apart, self.testing.protocol.test.apart, strict=True)
            sets += [frames for apart, pressed in tests for frames in self._apart(apart, pressed)]
        return tuple(sets)

    def _apart(self, apart: ApartTest, pressed: ApartTest) -> Iterator[GeneratedFrameSet]:
        """Yield the frames of presses that are scored apart.

        Instances press the scenes in turn, so that every instance presses all conditions of a draw.
        They are left out for a sensor without instances, and where the tested sensor is not the
        nominal one.

        Args:
            apart: The test of the protocol, whose instances name the groups.
            pressed: The test with the instances that press, which a hidden seed chooses.
        """
        for name in apart.sets:
            scenes = self.testing.draw(name).scenes
            if not apart.instances:
                group, rows = subgroup(apart.name, name), range(len(scenes))
                yield self._frame_set(self.testing, "test", name, rows, WHOLE, group)
            elif self.testing.component.values.get(INSTANCE) == NOMINAL:
                for turn, instance in enumerate(pressed.instances):
                    rows = range(turn, len(scenes), len(pressed.instances))
                    frames = self.testing.with_values(**{INSTANCE: instance})
                    group = subgroup(apart.name, f"{INSTANCE}-{apart.instances[turn]}")
                    yield self._frame_set(frames, "test", name, rows, FIRST_INSTANCE + turn, group)

    def _labelled_frames(self) -> FrameSet:
        """Return labelled presses of the tested sensor; a hidden seed draws the test alone."""
        request = self.request
        frames = SensorFrames(self.spec, request.tested, request.cache)
        scenes = draw_labelled(frames.pressed, request.shots).scenes
        return frames.frame_set(
            "few-shot",
            FEW_SHOT,
            scenes,
            [f"{FEW_SHOT}-{row}" for row in range(len(scenes))],
            WHOLE,
            stream=LABELLED_STREAM,
            groups=["all"] * len(scenes),
        )

    def _part(self, name: str, part: int) -> int:
        """Return the number of a part; only the split's draw is divided."""
        return part if name == self.split.draw else WHOLE

    def rejected(self) -> int:
        """Return how many candidates of the test draws did not fit the workspace."""
        names = [name for name in self.spec.tested_draws if name != self.split.draw]
        return sum(self.testing.draw(name).rejected for name in names)

    def _frame_set(
        self,
        frames: SensorFrames,
        role: str,
        name: str,
        rows: Sequence[int],
        part: int,
        apart: str | None = None,
    ) -> GeneratedFrameSet:
        """Return the frames of some rows of a draw.

        Args:
            frames: The sensor that presses.
            role: "fit", "validation" or "test".
            name: Name of the draw.
            rows: Numbers of the presses in the draw.
            part: Number of the part of the draw.
            apart: Group of the frames where they are scored apart; None: they are not.
        """
        scenes = frames.draw(name).scenes
        return frames.frame_set(
            role,
            name,
            [scenes[row] for row in rows],
            [f"{name}-{row}" for row in rows],
            part,
            groups=None if apart is None else [apart] * len(rows),
            apart=apart is not None,
        )


class ReferenceFrames(DrawnFrames):
    """Scenes with as many tips as the test draws have, in the protocol's workspace and depths.

    There are no catch trials.
    """

    def test_frames(self) -> tuple[FrameSet, ...]:
        """Return the scenes that fit the workspace, by draw.

        Raises:
            UserError: No scene has the tips of a test draw inside the workspace, or the sensor does
                not name its scenes.
        """
        component, workspace = self.testing.component, self.testing.pressed.workspace
        fitting = [
            (draw, name)
            for draw, names in self._alike.items()
            for name in names
            if fits(self._scenes[name], workspace)
        ]
        if not fitting:
            raise UserError(
                f"none of the {len(self._scenes)} {component.spec.scenes} of sensor "
                f"{component.name!r} has the tips that protocol {self.spec.id!r} tests, inside its "
                "workspace; take another protocol, or leave --test reference out."
            )
        presses = self.testing.sensor.presses()
        chosen = spread(fitting, self.request.test_count)
        sets = []
        for draw in dict.fromkeys(draw for draw, _ in chosen):
            names = [name for of, name in chosen if of == draw]
            sets.append(
                self.testing.frame_set(
                    "test",
                    draw,
                    [self._scenes[name] for name in names],
                    names,
                    REFERENCE_PART,
                    presses=[presses.get(name, name) for name in names],
                )
            )
        return tuple(sets)

    def rejected(self) -> int:
        """Return how many scenes with the right tips lie outside of the workspace."""
        workspace = self.testing.pressed.workspace
        names = [name for names in self._alike.values() for name in names]
        return sum(not fits(self._scenes[name], workspace) for name in names)

    @cached_property
    def _scenes(self) -> dict[str, Scene]:
        scenes = self.testing.sensor.scenes()
        if scenes is None:
            raise UserError(
                f"sensor {self.testing.component.name!r} stands for reference scenes, but does not "
                "say which; fix the plugin."
            )
        return dict(scenes)

    @cached_property
    def _alike(self) -> dict[str, list[str]]:
        """Test draw -> scenes with its tips; one draw of each kind of indenter, no catch trials."""
        draws: dict[str, Draw] = {}
        for name in self.spec.test.sets:
            if name != self.spec.test.catch:
                draw = self.spec.draw(name)
                draws.setdefault(draw.indenter, draw)
        return {
            draw.name: [name for name, scene in self._scenes.items() if _has_tips_of(scene, draw)]
            for draw in draws.values()
        }


def _has_tips_of(scene: Scene, draw: Draw) -> bool:
    tips = scene.indenter
    return len(tips.offsets) == draw.tips and tips.radius == draw.radius_mm
