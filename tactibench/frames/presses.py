"""Presses: scenes with the frames that a sensor made of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from tactibench.contacts import Answer, Frame, Scene
from tactibench.geometry import plate_pose, true_contacts
from tactibench.protocols import Protocol


@dataclass(frozen=True)
class Presses:
    """Frames with their scenes, in order.

    Attributes:
        name: Name of the set.
        scenes: Scene of every frame.
        frames: The frames that the sensor made.
        names: Name of every frame, unique in the set.
        hash: Hash of frames and scenes.
        folder: Folder in which the frames are cached; None where they are not.
        dome_radius: Radius of the pressed surface, mm, inf where it is flat; None: the protocol's.
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
        """Return the answers that a model should give, from the poses actually reached.

        Args:
            answer: "contacts", "plate" or "sites".
            dome_radius: Radius of the protocol's dome, mm; the sensor's own radius goes before it.
        """
        if answer == "plate":
            return [plate_pose(scene) for scene in self.reached()]
        if answer == "sites":
            return [scene.sites for scene in self.scenes if scene.sites is not None]
        radius = dome_radius if self.dome_radius is None else self.dome_radius
        reached = zip(self.reached(), self.frames, strict=True)
        return [true_contacts(scene, radius, frame.force) for scene, frame in reached]

    def reached(self) -> list[Scene]:
        """Return the scenes with the poses that the sensor says it reached."""
        return [
            replace(scene, pose=frame.pose)
            for scene, frame in zip(self.scenes, self.frames, strict=True)
        ]


def true_answers(protocol: Protocol, sets: Iterable[Presses]) -> list[Answer]:
    """Return, for every frame of several sets in order, the answer that a protocol asks for."""
    radius = protocol.workspace.dome_radius_mm
    return [answer for presses in sets for answer in presses.truth(protocol.answer, radius)]
