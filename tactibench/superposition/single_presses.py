"""Frames with one contact, on one sensor or on several, from which fields are learned."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Frame
from tactibench.markers import AlignedSensors
from tactibench.superposition.field import FieldFamily, contact_array, single_press_rows

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

_QUIETEST_PX = 0.003
"""Least standard deviation that a displacement is assumed to have."""


@dataclass(frozen=True, eq=False)
class TrackedFrame:
    """The pins of a frame.

    Attributes:
        sensor: Number of the frame's sensor.
        image: (side, side) gray.
        moved: (Q,) displacements, px of the layout.
        sure: (P,) whether a pin is surely itself.
    """

    sensor: int
    image: Image
    moved: Array
    sure: npt.NDArray[np.bool_]


def track(sensors: AlignedSensors, frames: Sequence[Frame]) -> list[TrackedFrame]:
    """Return the pins of every frame, on the layout of the sensors."""
    out: list[TrackedFrame | None] = [None] * len(frames)
    for number, rows in sensors.rows(frames).items():
        sensor = sensors[number]
        images = sensor.pins.images([frames[row] for row in rows])
        for row, image, moved, sure in zip(rows, images, *sensor.track(images), strict=True):
            out[row] = TrackedFrame(number, image, moved, sure)
    return [tracked for tracked in out if tracked is not None]


@dataclass(frozen=True, eq=False)
class SinglePresses:
    """Frames with one contact.

    Attributes:
        seen: The sensors, whose pins lie on one layout.
        frames: N frames.
        contacts: (N, 3) x, y, depth, mm.
        moved: (N, Q) displacements of the pins, px of the layout.
        sensors: (N,) numbers of the sensors.
    """

    seen: AlignedSensors
    frames: list[Frame]
    contacts: Array
    moved: Array
    sensors: npt.NDArray[np.intp]

    @classmethod
    def of(
        cls, seen: AlignedSensors, frames: Sequence[Frame], truth: Sequence[Answer]
    ) -> SinglePresses:
        """Return those of the frames that have one contact."""
        rows = single_press_rows(truth)
        singles = [frames[int(row)] for row in rows]
        true = [truth[int(row)] for row in rows]
        contacts = contact_array(true)[:, 0] if true else np.empty((0, 3))
        tracked = track(seen, singles)
        moved = np.empty((len(singles), 2 * len(seen.first.rest)))
        for row, frame in enumerate(tracked):
            moved[row] = frame.moved
        sensors = np.array([frame.sensor for frame in tracked], dtype=np.intp)
        return cls(seen, singles, contacts, moved, sensors)

    def parted(self, sensors: npt.NDArray[np.intp]) -> tuple[SinglePresses, SinglePresses]:
        """Return the presses on all other sensors, and those on the given sensors."""
        given = np.isin(self.sensors, sensors)
        return self._some(~given), self._some(given)

    def with_others(self, other: SinglePresses) -> SinglePresses:
        """Return these presses and the others together."""
        return SinglePresses(
            self.seen,
            self.frames + other.frames,
            np.concatenate([self.contacts, other.contacts]),
            np.concatenate([self.moved, other.moved]),
            np.concatenate([self.sensors, other.sensors]),
        )

    def by_sensor(self) -> Iterator[tuple[int, Array, Array]]:
        """Yield each sensor's number, contacts and displacements."""
        for number in np.unique(self.sensors):
            rows = self.sensors == number
            yield int(number), self.contacts[rows], self.moved[rows]

    def learn_family(self) -> FieldFamily:
        """Learn the fields, and how they vary from sensor to sensor.

        Raises:
            UserError: There are fewer than twenty presses.
        """
        numbers, sensors = np.unique(self.sensors, return_inverse=True)
        rests = np.array([self.seen[int(number)].layout_clues for number in numbers])
        return FieldFamily.learn(
            self.contacts, self.moved, sensors, rests, len(self.seen.first.rest)
        )

    def unexplained(self, family: FieldFamily) -> Array:
        """Return the (N, Q) residuals of the presses, px, with all numbers fitted to them."""
        left = np.empty_like(self.moved)
        for number, contacts, moved in self.by_sensor():
            field = family.of_sensor(self.seen[number].layout_clues, contacts, moved)
            left[self.sensors == number] = field.residual(contacts, moved)
        return left

    def _some(self, rows: npt.NDArray[np.bool_]) -> SinglePresses:
        frames = [frame for frame, keep in zip(self.frames, rows, strict=True) if keep]
        return SinglePresses(
            self.seen, frames, self.contacts[rows], self.moved[rows], self.sensors[rows]
        )


def noise_weight(residual: Array) -> Array:
    """Return (Q,) 1 / variance of displacements, 1 / px^2, from residuals (N, Q) of presses, px.

    It is robust: a pin that was mistaken for another in one frame is no noise.
    """
    if not len(residual):
        return np.full(residual.shape[1], 1 / _QUIETEST_PX**2)
    deviation = np.maximum(1.4826 * np.median(np.abs(residual), axis=0), _QUIETEST_PX)
    weight: Array = 1 / deviation**2
    return weight
