"""Frames with one contact, on one sensor or on several."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench import Frame

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SinglePresses:
    """Frames with one contact.

    Attributes:
        frames: N frames.
        contacts: (N, 3) x, y, depth, mm.
        moved: (N, Q) displacements of the pins, px of the layout.
        sensors: (N,) numbers of the sensors.
    """

    frames: list[Frame]
    contacts: Array
    moved: Array
    sensors: npt.NDArray[np.intp]

    def parted(self, sensors: npt.NDArray[np.intp]) -> tuple[SinglePresses, SinglePresses]:
        """Return the presses on all other sensors, and those on the given sensors."""
        given = np.isin(self.sensors, sensors)
        return self._some(~given), self._some(given)

    def with_others(self, other: SinglePresses) -> SinglePresses:
        """Return these presses and the others together."""
        return SinglePresses(
            self.frames + other.frames,
            np.concatenate([self.contacts, other.contacts]),
            np.concatenate([self.moved, other.moved]),
            np.concatenate([self.sensors, other.sensors]),
        )

    def _some(self, rows: npt.NDArray[np.bool_]) -> SinglePresses:
        frames = [frame for frame, keep in zip(self.frames, rows, strict=True) if keep]
        return SinglePresses(frames, self.contacts[rows], self.moved[rows], self.sensors[rows])
