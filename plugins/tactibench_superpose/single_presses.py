"""Frames with one contact, on one sensor or on several."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench import Frame

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SinglePresses:
    """Frames with one contact."""

    frames: list[Frame]
    contacts: Array
    """(N, 3) mm."""
    moved: Array
    """(N, Q) px of the layout."""
    sensors: npt.NDArray[np.intp]
    """(N,) numbers."""

    def parted(self, sensors: npt.NDArray[np.intp]) -> tuple[SinglePresses, SinglePresses]:
        """Return the presses on other sensors than these, and those on these."""
        there = np.isin(self.sensors, sensors)
        return self._some(~there), self._some(there)

    def with_others(self, other: SinglePresses) -> SinglePresses:
        """Return these presses and others."""
        return SinglePresses(
            self.frames + other.frames,
            np.concatenate([self.contacts, other.contacts]),
            np.concatenate([self.moved, other.moved]),
            np.concatenate([self.sensors, other.sensors]),
        )

    def _some(self, rows: npt.NDArray[np.bool_]) -> SinglePresses:
        own = [frame for frame, there in zip(self.frames, rows, strict=True) if there]
        return SinglePresses(own, self.contacts[rows], self.moved[rows], self.sensors[rows])
