"""Presses: scenes with the frames a sensor made of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from tactibench.contacts import Answer, Frame, Scene
from tactibench.geometry import plate_pose, true_contacts


@dataclass(frozen=True)
class Presses:
    """Frames with their scenes, in order.

    names: id of every press, unique in a data set. hash: of the frames and scenes.
    folder: where the frames are cached, None when they are not. dome_radius: of the surface that
    was pressed, mm, inf where it is flat; None: the protocol's.
    """

    name: str
    scenes: tuple[Scene, ...]
    frames: Sequence[Frame] = field(repr=False)
    names: tuple[str, ...]
    hash: str
    folder: Path | None = None
    dome_radius: float | None = None

    def __len__(self) -> int:
        return len(self.scenes)

    def truth(self, answer: str, dome_radius: float) -> list[Answer]:
        """What a model should answer, from the poses actually reached.

        dome_radius: of the protocol, mm; the sensor's own radius goes before it.
        """
        if answer == "plate":
            return [plate_pose(scene) for scene in self.reached()]
        radius = dome_radius if self.dome_radius is None else self.dome_radius
        return [true_contacts(scene, radius) for scene in self.reached()]

    def reached(self) -> list[Scene]:
        """The scenes with the poses that the sensor says it reached."""
        return [
            replace(scene, pose=frame.pose)
            for scene, frame in zip(self.scenes, self.frames, strict=True)
        ]
