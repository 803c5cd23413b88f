"""A handful of frames, pressed by a sensor that the plugin host names."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactibench.contacts import Answer, Frame, Indenter, Pose, Scene
from tactibench.errors import UserError
from tactibench.geometry import plate_pose, true_contacts
from tactibench.plugins.base import Sensor, SensorContext
from tactibench.plugins.host import PluginHost
from tactibench.protocols.draws import draw_scenes, pressable
from tactibench.protocols.loader import load_protocol
from tactibench.protocols.schema import Protocol

PROTOCOL = "exp1"
"""Whose workspace, grid, draws and default sensor and encoder the checks take."""


@dataclass(frozen=True)
class Examples:
    """Frames as a sensor gives them, and what is true of them."""

    frames: tuple[Frame, ...]
    truth: tuple[Answer, ...]

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, rows: slice) -> Examples:
        return Examples(self.frames[rows], self.truth[rows])

    def __add__(self, other: Examples) -> Examples:
        return Examples(self.frames + other.frames, self.truth + other.truth)


def writable(frame: Frame) -> Frame:
    """A copy of a frame whose images may be written to."""
    rest = None if frame.rest is None else frame.rest.copy()
    return replace(frame, image=frame.image.copy(), rest=rest)


def changes(before: Examples, after: Examples) -> str:
    """What is other than before, in words; "": nothing."""
    pairs = list(zip(before.frames, after.frames, strict=True))
    if any(one.image.tobytes() != other.image.tobytes() for one, other in pairs):
        return "the image of a frame"
    rests = [[f.rest.tobytes() for f in pair if f.rest is not None] for pair in pairs]
    return "the rest image of a frame" if any(len(set(rest)) > 1 for rest in rests) else ""


@dataclass(frozen=True)
class Presser:
    """keys: the protocol on the sensor's own surface. name, sensor: what presses."""

    keys: Protocol
    name: str
    sensor: Sensor

    @classmethod
    def of(cls, host: PluginHost, name: str = "") -> Presser:
        """The sensor of that name with its default parameters; "": the protocol's default.

        Raises UserError for an unknown sensor, and for one that needs data of its own.
        """
        keys = load_protocol(PROTOCOL).keys
        spec = host.sensors[name or keys.defaults.sensor]
        if spec.needs_data or spec.reference_of:
            raise UserError(
                f"sensor {spec.name!r} presses only the scenes that it has, but the checks of a "
                f"model draw their own; take another, such as {keys.defaults.sensor!r}."
            )
        sensor = spec.load()(SensorContext(np.random.SeedSequence(1)), **spec.settings({}))
        return cls(pressable(keys, sensor), spec.name, sensor)

    def singles(self, count: int) -> Examples:
        """One spherical tip, within the workspace."""
        return self._contacts(self._draw(0, count))

    def several(self, count: int) -> Examples:
        """Two and three tips in turn."""
        duals, triples = self._draw(1, count), self._draw(2, count)
        mixed = [scene for pair in zip(duals, triples, strict=True) for scene in pair]
        return self._contacts(mixed[:count])

    def plates(self, count: int) -> Examples:
        """A plate, tilted along x. Raises UserError where the sensor cannot press one."""
        rng = np.random.default_rng(5)
        scenes = [
            Scene(Indenter.plate(), Pose(tilt=float(tilt), depth=float(depth)))
            for tilt, depth in zip(
                rng.uniform(-15, 15, count), rng.uniform(1, 4, count), strict=True
            )
        ]
        return Examples(self._frames(scenes), tuple(map(plate_pose, scenes)))

    def rest(self) -> Frame:
        with self.sensor as opened:
            return opened.rest()

    def _draw(self, number: int, count: int) -> Sequence[Scene]:
        """The first presses of a draw of the protocol."""
        draw = self.keys.draws[number].model_copy(update={"count": count})
        draws = (*self.keys.draws[:number], draw, *self.keys.draws[number + 1 :])
        return draw_scenes(self.keys.model_copy(update={"draws": draws}), draw.name).scenes

    def _contacts(self, scenes: Sequence[Scene]) -> Examples:
        radius = self.keys.workspace.dome_radius_mm
        return Examples(
            self._frames(scenes), tuple(true_contacts(scene, radius) for scene in scenes)
        )

    def _frames(self, scenes: Iterable[Scene]) -> tuple[Frame, ...]:
        """Their images may not be written to, as those that a run takes from its cache."""
        with self.sensor as opened:
            frames = tuple(opened.press_many(scenes))
        for frame in frames:
            frame.image.setflags(write=False)
        return frames
