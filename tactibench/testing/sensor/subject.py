"""A sensor under test, and the scenes that it is asked to press."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Frame, Indenter, Pose, Scene
from tactibench.frames.source import spread
from tactibench.plugins.base import Sensor, SensorContext
from tactibench.plugins.specs import SensorSpec, Value
from tactibench.protocols.draws import draw_scenes, pressable
from tactibench.protocols.loader import load_protocol
from tactibench.protocols.schema import Protocol
from tactibench.testing.pressed import PROTOCOL
from tactibench.testing.property import NotApplicable

COUNT = 8
"""Presses of a check."""

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SensorSubject:
    """spec, values: the sensor and its parameters. data: its folder, or None."""

    title: str
    spec: SensorSpec
    values: Mapping[str, Value]
    data: Path | None = None

    def build(self, values: Mapping[str, Value] | None = None, seed: int = 0) -> Sensor:
        """A sensor that nobody has opened. values: of all parameters; None: the subject's."""
        context = SensorContext(np.random.SeedSequence(seed), self.data)
        return self.spec.load()(context, **(self.values if values is None else values))

    @cached_property
    def described(self) -> Sensor:
        """A sensor that is asked, not pressed."""
        return self.build()

    @property
    def own_scenes(self) -> bool:
        """Whether it can press only what it has."""
        return self.described.scenes() is not None

    @cached_property
    def keys(self) -> Protocol:
        """The protocol whose workspace it is pressed in, on the sensor's own surface."""
        return pressable(load_protocol(PROTOCOL).keys, self.described)

    @cached_property
    def scenes(self) -> tuple[Scene, ...]:
        """A few presses: of the protocol, or of those that it has."""
        own = self.described.scenes()
        if own is not None:
            return spread(list(own.values()), COUNT)
        return draw_scenes(self.keys, self.keys.draws[0].name).scenes[:COUNT]

    def pressed(self, *scenes: Scene, seed: int = 0) -> list[Frame]:
        """Frames of a new sensor that presses one after the other."""
        with self.build(seed=seed) as opened:
            return [opened.press(scene) for scene in scenes]

    def must_press_anything(self) -> None:
        if self.own_scenes:
            raise NotApplicable("it presses only the scenes that it has")

    def must_repeat(self) -> None:
        """Raise NotApplicable where a seed cannot determine the frames."""
        if self.spec.origin == "real" and not self.own_scenes:
            raise NotApplicable("no seed determines the noise of a real sensor")


def tip(x: float, y: float, depth: float) -> Scene:
    """One spherical tip of 3 mm."""
    return Scene(Indenter.single(), Pose(x, y, 0.0, 0.0, depth))


def image(frame: Frame) -> Floats:
    """(H, W) grey levels, colours averaged."""
    levels = np.asarray(frame.image, dtype=np.float64)
    return levels.mean(axis=2) if levels.ndim == 3 else levels


def change(frame: Frame, rest: Frame) -> Floats:
    """(H, W) squared change of every pixel against the undeformed sensor."""
    return np.square(image(frame) - image(rest))


def middle(energy: Floats) -> tuple[float, float]:
    """Column and row of the middle of (H, W) change, px."""
    total = float(energy.sum())
    rows, columns = np.indices(energy.shape)
    return float((energy * columns).sum() / total), float((energy * rows).sum() / total)
