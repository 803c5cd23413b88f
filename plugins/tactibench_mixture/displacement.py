"""Displacement fields: those of the pins, interpolated on a square of cells."""

from __future__ import annotations

from typing import Self

import numpy as np
import numpy.typing as npt
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree

from tactibench.markers import PinTracker, Tracks
from tactibench.training import pack_image, unpack_image

Floats = npt.NDArray[np.float32]

_SYMMETRIC_PX = 0.05
"""Rms distance of mirrored pins from the pins up to which they are the same pins."""


class DisplacementField:
    """Displacement of the skin in every cell of a frame, interpolated between the pins.

    The interpolant is the smoothest sum of cones on the pins (linear radial basis functions), so
    that a field is one product of a fixed matrix with the displacements.
    """

    def __init__(self, pins: PinTracker, cells: int) -> None:
        """Compute the matrix from displacements of pins to cells.

        Args:
            pins: Tracker of the pins that are the layout.
            cells: Cells along a side.
        """
        self.pins = pins
        self.cells = cells
        axis = (np.arange(cells) + 0.5) * pins.side / cells - 0.5
        places = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
        spread = RBFInterpolator(pins.rest, np.eye(len(pins.rest)), kernel="linear")(places)
        self._spread: Floats = np.asarray(spread, dtype=np.float32)

    def __call__(self, tracks: Tracks) -> Floats:
        """Return displacements in x and y, (N, 2, cells, cells), px, from pins on the layout."""
        moved = (tracks.xy - self.pins.rest).astype(np.float32)
        field = np.matmul(self._spread, moved).transpose(0, 2, 1)
        shape = (len(tracks), 2, self.cells, self.cells)
        return np.ascontiguousarray(field).reshape(shape)

    @property
    def symmetry(self) -> tuple[bool, bool]:
        """(x, y): whether the pins at rest stay the same with that axis reversed."""
        pins, last = self.pins.rest, self.pins.side - 1
        return _coincide(pins, np.abs([last, 0] - pins)), _coincide(pins, np.abs([0, last] - pins))

    def to_json(self) -> dict[str, str | int]:
        """Return JSON values from which ``from_json`` makes the same field."""
        return {"rest": pack_image(self.pins.rest_image), "cells": self.cells}

    @classmethod
    def from_json(cls, values: dict[str, str | int]) -> Self:
        """Return the field of ``to_json``."""
        return cls(PinTracker(unpack_image(str(values["rest"]))), int(values["cells"]))


def _coincide(pins: npt.NDArray[np.float64], mirrored: npt.NDArray[np.float64]) -> bool:
    distance, _ = cKDTree(pins).query(mirrored)
    return bool(np.sqrt(np.square(distance).mean()) < _SYMMETRIC_PX)
