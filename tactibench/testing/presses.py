"""Presses for the check of a model: a handful of frames of one sensor, and their truth."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactibench.contacts import Answer, Frame, Indenter, Pose, Scene
from tactibench.errors import UserError
from tactibench.geometry import plate_pose, true_contacts
from tactibench.plugins import PluginHost, Sensor, SensorContext
from tactibench.protocols import Protocol, draw_scenes, load_protocol, pressable

PROTOCOL = "exp1"
"""Protocol whose workspace, grid, draws, default sensor and default encoder the checks use."""


@dataclass(frozen=True)
class Examples:
    """Frames of a sensor, and their truth.

    Attributes:
        frames: The frames as the sensor gives them.
        truth: True answer to every frame.
    """

    frames: tuple[Frame, ...]
    truth: tuple[Answer, ...]

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, rows: slice) -> Examples:
        return Examples(self.frames[rows], self.truth[rows])

    def __add__(self, other: Examples) -> Examples:
        return Examples(self.frames + other.frames, self.truth + other.truth)


def writable(frame: Frame) -> Frame:
    """Return a copy of a frame whose signals may be written to."""
    rest = None if frame.rest is None else frame.rest.copy()
    return replace(frame, signal=frame.signal.copy(), rest=rest)


def changed_images(before: Sequence[Frame], after: Sequence[Frame]) -> str:
    """Return words for the first images that differ between two lists of frames, "" for none."""
    for first, second in zip(before, after, strict=True):
        if first.signal.tobytes() != second.signal.tobytes():
            return "the image of a frame"
        rests = [frame.rest.tobytes() for frame in (first, second) if frame.rest is not None]
        if len(set(rests)) > 1:
            return "the rest image of a frame"
    return ""


@dataclass(frozen=True)
class SensorPresses:
    """Presses by one sensor.

    Attributes:
        protocol: The protocol whose presses are drawn, on the sensor's own surface.
        name: Name of the sensor.
        sensor: The sensor.
    """

    protocol: Protocol
    name: str
    sensor: Sensor

    @classmethod
    def by_name(cls, host: PluginHost, name: str = "") -> SensorPresses:
        """Return the presses of a sensor with its default parameters.

        Args:
            host: The plugins.
            name: Name of the sensor; "" for the protocol's default sensor.

        Raises:
            UserError: The sensor is unknown, or presses only recorded or reference scenes.
        """
        protocol = load_protocol(PROTOCOL).spec
        spec = host.sensors[name or protocol.defaults.sensor]
        if spec.needs_data or spec.reference_of:
            raise UserError(
                f"sensor {spec.name!r} presses only the scenes that it has, but the checks of a "
                f"model draw their own; take another, such as {protocol.defaults.sensor!r}."
            )
        sensor = spec.load()(SensorContext(np.random.SeedSequence(1)), **spec.settings({}))
        return cls(pressable(protocol, sensor), spec.name, sensor)

    def singles(self, count: int) -> Examples:
        """Return presses of one spherical tip within the workspace."""
        return self._press_tips(self._draw(0, count))

    def several(self, count: int) -> Examples:
        """Return presses of two and three tips in turn."""
        duals, triples = self._draw(1, count), self._draw(2, count)
        in_turn = [scene for pair in zip(duals, triples, strict=True) for scene in pair]
        return self._press_tips(in_turn[:count])

    def plates(self, count: int) -> Examples:
        """Return presses of a plate that is tilted along x.

        Raises:
            UserError: The sensor cannot press a plate.
        """
        rng = np.random.default_rng(5)
        tilts, depths = rng.uniform(-15, 15, count), rng.uniform(1, 4, count)
        scenes = [
            Scene(Indenter.plate(), Pose(tilt=float(tilt), depth=float(depth)))
            for tilt, depth in zip(tilts, depths, strict=True)
        ]
        return Examples(self._press(scenes), tuple(map(plate_pose, scenes)))

    def rest(self) -> Frame:
        """Return a frame of the undeformed sensor."""
        with self.sensor as opened:
            return opened.rest()

    def _draw(self, number: int, count: int) -> Sequence[Scene]:
        """Return the first ``count`` presses of the draw of a number in the protocol."""
        draws = list(self.protocol.draws)
        draws[number] = draws[number].model_copy(update={"count": count})
        shortened = self.protocol.model_copy(update={"draws": tuple(draws)})
        return draw_scenes(shortened, draws[number].name).scenes

    def _press_tips(self, scenes: Sequence[Scene]) -> Examples:
        radius = self.protocol.workspace.dome_radius_mm
        truth = tuple(true_contacts(scene, radius) for scene in scenes)
        return Examples(self._press(scenes), truth)

    def _press(self, scenes: Iterable[Scene]) -> tuple[Frame, ...]:
        with self.sensor as opened:
            frames = tuple(opened.press_many(scenes))
        for frame in frames:
            frame.signal.setflags(write=False)  # as in frames that a run takes from its cache
        return frames
