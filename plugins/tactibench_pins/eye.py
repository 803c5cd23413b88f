"""Frames as displacements: of the pins of one sensor, or on the lattice that all sensors share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from tactibench import Frame, UserError
from tactibench.markers import common_view, lattice
from tactibench.superposition import Eye

Array = npt.NDArray[np.float64]
LATTICE = lattice()


class Sight(Protocol):
    """What a model sees of frames. still: (side, side) gray, the sensor that it was trained on."""

    @property
    def still(self) -> npt.NDArray[np.uint8]: ...

    @property
    def places(self) -> int:
        """P, how many displacements there are."""
        ...

    def see(self, frames: Sequence[Frame]) -> Array:
        """(N, 2 P), x of all places, then y of all."""
        ...


@dataclass(frozen=True, eq=False)
class OwnPins:
    """One sensor's pins, px."""

    eye: Eye

    @property
    def still(self) -> npt.NDArray[np.uint8]:
        return self.eye.still

    @property
    def places(self) -> int:
        return len(self.eye.rest)

    def see(self, frames: Sequence[Frame]) -> Array:
        return self.eye.moved(self.eye.images(frames))


@dataclass(frozen=True, eq=False)
class AnyPins:
    """Any sensor's pins, carried over to the common lattice; the rest images of the frames tell
    which sensor it is.

    eye: of the sensor that it was trained on. known: (rest image, eye, view) of sensors seen.
    """

    eye: Eye
    known: list[tuple[npt.NDArray[np.uint8], Eye, Any]] = field(default_factory=list)

    @property
    def still(self) -> npt.NDArray[np.uint8]:
        return self.eye.still

    @property
    def places(self) -> int:
        return len(LATTICE)

    def see(self, frames: Sequence[Frame]) -> Array:
        """Raises UserError for a frame without a rest image, or with one that shows no layout."""
        out = np.empty((len(frames), 2 * self.places))
        of = [self._sensor(frame) for frame in frames]
        for number in set(of):
            rows = [row for row, other in enumerate(of) if other == number]
            _, eye, view = self.known[number]
            out[rows] = view(eye.moved(eye.images([frames[row] for row in rows])))
        return out

    def _sensor(self, frame: Frame) -> int:
        """Number of the frame's sensor among the known ones."""
        rest = frame.rest
        if rest is None:
            raise UserError(
                "a frame carries no rest image, by which a sensor's pins are told from another's; "
                "record one of the untouched sensor (init_0.png)."
            )
        for number, (other, _, _) in enumerate(self.known):
            if other is rest or (other.shape == rest.shape and np.array_equal(other, rest)):
                return number
        eye = Eye.of([frame])
        self.known.append((rest, eye, common_view(eye.rest, LATTICE)))
        return len(self.known) - 1


def sight(frames: Sequence[Frame], known: Array, transfers: bool) -> Sight:
    """Follows the pins from their places in the rest image of the first frame that has one, or
    else in the frame that is pressed least.

    known: (N, T) targets, the depth of a plate first, that of a contact last. transfers: whether
    other sensors' frames will be shown, too.
    """
    depth = known[:, 0] if known.shape[1] == 2 else known[:, -1]
    eye = Eye.of(frames, otherwise=frames[int(np.argmin(depth))])
    return AnyPins(eye) if transfers else OwnPins(eye)


def sight_at(still: npt.NDArray[np.uint8], transfers: bool) -> Sight:
    """From a gray image of the untouched sensor."""
    return AnyPins(Eye.at(still)) if transfers else OwnPins(Eye.at(still))


def displacements(seen_by: Sight | None, frames: Sequence[Frame], model: str) -> Array:
    """(N, 2 P), x of all places, then y of all. Raises UserError before anything is learned."""
    if seen_by is None:
        raise UserError(f"model {model!r} knows no pins yet; train it or load weights first.")
    return seen_by.see(frames)
