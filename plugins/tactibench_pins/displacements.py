"""Frames as displacements of pins, their principal components, and where a contact begins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from tactibench import Answer, Contacts, Frame, UserError
from tactibench.markers import BySensor, PinTracker, common_lattice, common_view, rest_images
from tactibench.training import answers_from_vectors, pack_image, unpack_image

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

LATTICE = common_lattice()
_FAINTEST = 0.01
"""Quantile of the training presses that stands for the faintest: one may be mislabelled."""
_SHARE = 0.5
"""Share of the way from a sensor at rest to the faintest training press where a contact begins."""
_LEAST = 1e-6
"""Spreads below this share of the largest are rounding."""


class OwnPins:
    """Displacements of one sensor's pins, px."""

    def __init__(self, pins: PinTracker) -> None:
        self.pins = pins

    @property
    def rest_image(self) -> Image:
        """Gray rest image (side, side) of the sensor that the model was trained on."""
        return self.pins.rest_image

    @property
    def places(self) -> int:
        """Number P of displacements."""
        return len(self.pins.rest)

    def displacements(self, frames: Sequence[Frame]) -> Array:
        """Return (N, 2 P), x of all places before y of all."""
        return self.pins.displacements(self.pins.images(frames))


class LatticePins(OwnPins):
    """Displacements of any sensor's pins on the common lattice, in units of the layout.

    The rest images of the frames tell which sensor it is.
    """

    def __init__(self, pins: PinTracker) -> None:
        super().__init__(pins)
        self._sensors = BySensor(lambda pins: (pins, common_view(pins.rest, LATTICE)))

    @property
    def places(self) -> int:
        """Number P of points of the lattice."""
        return len(LATTICE)

    def displacements(self, frames: Sequence[Frame]) -> Array:
        """Return (N, 2 P), x of all places before y of all.

        Raises:
            UserError: for a frame without a rest image, or with one that shows no layout.
        """
        out = np.empty((len(frames), 2 * self.places))
        for number, rows in self._sensors.rows(frames).items():
            pins, view = self._sensors[number]
            out[rows] = view(pins.displacements(pins.images([frames[row] for row in rows])))
        return out


def find_pins(frames: Sequence[Frame], targets: Array, transfers: bool) -> OwnPins:
    """Return the pins of the first rest image, or else of the frame that is pressed least.

    Frames of several sensor instances are seen on the common lattice, each from its own rest image.

    Args:
        frames: of one sensor, or of several instances of it.
        targets: (N, T), the depth of a plate first, that of a contact last.
        transfers: whether other sensors' frames will be shown, too.
    """
    depth = targets[:, 0] if targets.shape[1] == 2 else targets[:, -1]
    if len(rest_images(frames)) > 1:
        first = next(frame for frame in frames if frame.rest is not None)
        return LatticePins(PinTracker.of([first]))
    return read_pins(PinTracker.of(frames, otherwise=frames[int(np.argmin(depth))]), transfers)


def read_pins(pins: PinTracker, lattice: bool) -> OwnPins:
    """Return the displacements of pins; lattice: whether those of other sensors are read, too."""
    return LatticePins(pins) if lattice else OwnPins(pins)


def saved_pins(pins: OwnPins | None, transfers: bool) -> dict[str, Any]:
    """Return what a model saves of its pins, as JSON values.

    With ``transfers`` the lattice goes without saying.
    """
    rest = None if pins is None else pack_image(pins.rest_image)
    lattice = isinstance(pins, LatticePins) and not transfers
    return {"rest": rest, **({"lattice": True} if lattice else {})}


def restored_pins(extra: Mapping[str, Any], transfers: bool) -> OwnPins | None:
    """Return the pins of ``saved_pins``; None where there were none."""
    if extra["rest"] is None:
        return None
    return read_pins(PinTracker(unpack_image(extra["rest"])), transfers or "lattice" in extra)


def displacements(pins: OwnPins | None, frames: Sequence[Frame], model: str) -> Array:
    """Return (N, 2 P) displacements.

    Raises:
        UserError: before anything is learned.
    """
    if pins is None:
        raise UserError(f"model {model!r} knows no pins yet; train it or load weights first.")
    return pins.displacements(frames)


@dataclass(frozen=True, eq=False)
class Components:
    """Principal components of displacements: few numbers, each a pattern of all pins.

    Attributes:
        mean: (2 P,) displacement, px.
        basis: (2 P, K) orthonormal patterns.
        spread: (K,) standard deviations over the frames of the fit, px, descending.
    """

    mean: Array
    basis: Array
    spread: Array

    @classmethod
    def fit(cls, moved: Array, count: int) -> Self:
        """Return the first ``count`` components with any spread of displacements (N, 2 P)."""
        mean = moved.mean(axis=0)
        centred = moved - mean
        variance, basis = np.linalg.eigh(centred.T @ centred / len(moved))
        spread = np.sqrt(np.maximum(variance[::-1], 0.0))
        there = max(1, int(np.count_nonzero(spread[:count] > _LEAST * spread[0])))
        return cls(mean, np.ascontiguousarray(basis[:, ::-1][:, :there]), spread[:there])

    def __len__(self) -> int:
        return len(self.spread)

    def first(self, count: int) -> Self:
        """Return the first ``count`` components."""
        return type(self)(self.mean, self.basis[:, :count], self.spread[:count])

    def weights(self, whitening: float) -> Array:
        """Return (K,) 1 / spread^whitening: 0 keeps pixels, 1 makes all spread alike."""
        least = np.maximum(self.spread, 1e-9)
        return np.asarray((least / least[0]) ** -whitening / least[0], dtype=np.float64)

    def of(self, moved: Array, whitening: float) -> Array:
        """Return (N, K) of displacements (N, 2 P), the first with unit spread."""
        return np.asarray((moved - self.mean) @ self.basis * self.weights(whitening))


def rms_displacement(moved: Array) -> Array:
    """Return (N,) the root mean square of displacements (N, 2 P)."""
    rms: Array = np.sqrt(np.mean(np.square(moved), axis=1))
    return rms


def contact_threshold(moved: Array, answer: str) -> float:
    """Return the least rms displacement of a contact, from training presses (N, 2 P).

    0 for a plate: its pose is asked for in every frame.
    """
    if answer == "plate" or not len(moved):
        return 0.0
    return float(_SHARE * np.quantile(rms_displacement(moved), _FAINTEST))


def read_answers(values: npt.NDArray[Any], answer: str, threshold: float) -> list[Answer | None]:
    """Return answers of rows (N, T + 1): values, mm and deg, and the rms displacement.

    threshold: the rms below which there is no contact.
    """
    answers = answers_from_vectors(values[:, :-1], answer)
    none = Contacts.none()
    return [
        none if rms < threshold else pressed
        for pressed, rms in zip(answers, values[:, -1], strict=True)
    ]
