"""A recorded folder as a run reads it: rows in, sets of frames out that are read when opened."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from tactibench.contacts import Frame, Scene
from tactibench.frames.presses import Presses
from tactibench.frames.source import Advance, Wanted
from tactibench.plugins.base import Sensor
from tactibench.records.identity import digest


@dataclass(frozen=True)
class Folder:
    """names, scenes, presses: of every frame; frames of one press share it."""

    sensor: Sensor
    identity: dict[str, Any]
    names: tuple[str, ...]
    scenes: tuple[Scene, ...]
    presses: tuple[str, ...]
    parts: tuple[str, ...] | None = None
    """Of every frame, the part of the recording's own split, "" for none; None: it has no split."""

    @classmethod
    def of(cls, sensor: Sensor, scenes: Mapping[str, Scene], identity: dict[str, Any]) -> Folder:
        """The frames of a sensor with scenes; where it says nothing, each is a press of its own."""
        known = sensor.presses()
        presses = tuple(known.get(name, name) for name in scenes)
        own = sensor.split()
        parts = tuple(own.get(name, "") for name in scenes) if own else None
        return cls(sensor, identity, tuple(scenes), tuple(scenes.values()), presses, parts)

    def take(self, rows: Sequence[int]) -> Folder:
        """Some of the frames."""
        return replace(
            self,
            names=tuple(self.names[row] for row in rows),
            scenes=tuple(self.scenes[row] for row in rows),
            presses=tuple(self.presses[row] for row in rows),
            parts=None if self.parts is None else tuple(self.parts[row] for row in rows),
        )

    def want(
        self,
        role: str,
        name: str,
        rows: Sequence[int],
        group: Callable[[Scene], str] = lambda _: "all",
    ) -> Wanted:
        """The frames of some rows. group: of every press, in the result tables."""
        chosen = tuple(self.names[row] for row in rows)
        scenes = tuple(self.scenes[row] for row in rows)
        key = digest({"sensor": self.identity, "frames": chosen})
        radius = self.sensor.dome_radius_mm

        def read(advance: Advance) -> Presses:
            frames: list[Frame] = []
            with self.sensor:
                for frame in self.sensor.press_many(scenes):
                    frames.append(frame)
                    advance(1)
            return Presses(name, scenes, frames, chosen, key, dome_radius=radius)

        groups = tuple(group(scene) for scene in scenes)
        presses = tuple(self.presses[row] for row in rows)
        own = () if presses == chosen else presses
        return Wanted(role, name, scenes, groups, True, key, read, own, chosen)
