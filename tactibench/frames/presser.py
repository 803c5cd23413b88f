"""A sensor as a run presses it: scenes in, sets of frames out that are made when opened."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from tactibench.contacts import Scene
from tactibench.frames.cache import FrameRequest, folder_of, is_cached, open_frames
from tactibench.frames.source import Wanted, sensor_identity
from tactibench.plugins.base import Sensor, SensorContext
from tactibench.plugins.specs import SensorSpec
from tactibench.protocols.draws import SceneSet, draw_scenes, pressable
from tactibench.protocols.schema import Protocol
from tactibench.run.components import Part


@dataclass(frozen=True)
class Presser:
    """keys: the protocol. part, build: of the sensor. cache: where frames are kept. secret: whether
    the seed of the protocol's data must not be written down."""

    keys: Protocol
    part: Part[SensorSpec]
    build: Callable[[SensorContext], Sensor]
    cache: Path
    secret: bool = False

    @cached_property
    def sensor(self) -> Sensor:
        """Opened to be asked, not to be pressed."""
        return self.build(SensorContext(np.random.SeedSequence(0)))

    @cached_property
    def identity(self) -> dict[str, Any]:
        return sensor_identity(self.part, self.sensor.describe())

    @cached_property
    def pressed(self) -> Protocol:
        """The protocol on the sensor's own surface."""
        return pressable(self.keys, self.sensor)

    def draw(self, name: str) -> SceneSet:
        return draw_scenes(self.pressed, name)

    def want(
        self,
        role: str,
        name: str,
        scenes: Sequence[Scene],
        names: Sequence[str],
        part: int,
        presses: Sequence[str] = (),
        stream: int | None = None,
    ) -> Wanted:
        """Frames of scenes of a draw. part: of the draw; every part has noise of its own. stream:
        of that noise, None: the draw's."""
        radius = self.pressed.workspace.dome_radius_mm
        frames = FrameRequest(
            name,
            self.build,
            self.identity,
            tuple(scenes),
            tuple(names),
            (self.keys.data_seed, stream or self.keys.draw(name).stream, part),
            None if radius == self.keys.workspace.dome_radius_mm else radius,
            self.secret,
        )
        key = frames.key
        return Wanted(
            role,
            name,
            frames.scenes,
            tuple(group_of(self.keys, name, scene) for scene in frames.scenes),
            is_cached(folder_of(self.cache, key)),
            key,
            lambda advance: open_frames(frames, self.cache, advance),
            tuple(presses),
            frames.names,
        )


def group_of(keys: Protocol, draw: str, scene: Scene) -> str:
    if draw == keys.test.catch:
        return "catch"
    if keys.test.group == "distance":
        tips = np.array(scene.indenter.offsets)[:, :2]
        return str(round(float(np.linalg.norm(tips[0] - tips[-1])), 6))
    kind = scene.indenter.name.partition(" #")[0]  # a repeated press of a recording has a number
    return kind if keys.test.group == "indenter" else "all"
