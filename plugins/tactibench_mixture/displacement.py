"""Frames as what the skin does: the displacement of the pins, spread over a square of cells."""

from __future__ import annotations

from typing import Self

import numpy as np
import numpy.typing as npt
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree

from tactibench.superposition import Eye
from tactibench.training import pack_image, unpack_image

Floats = npt.NDArray[np.float32]
Images = npt.NDArray[np.uint8]

_SYMMETRIC_PX = 0.05
"""Rms distance of mirrored pins from pins, up to which they are the same."""


class DisplacementField:
    """Displacement of the skin in every cell of a frame, interpolated between the pins.

    eye: follows the pins from where they are at rest. cells: along a side. The interpolant is the
    smoothest sum of cones on the pins (linear radial basis functions), so that a field is one
    product of a fixed matrix with the displacements.
    """

    def __init__(self, eye: Eye, cells: int) -> None:
        self.eye = eye
        self.cells = cells
        pins = eye.rest
        axis = (np.arange(cells) + 0.5) * eye.side / cells - 0.5
        places = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
        spread = RBFInterpolator(pins, np.eye(len(pins)), kernel="linear")(places)
        self._spread: Floats = np.asarray(spread, dtype=np.float32)

    def __call__(self, images: Images) -> Floats:
        """(N, 2, cells, cells) displacement in x and y, px, of (N, S, S) uint8 frames."""
        moved = (self.eye.tracker.track(images).xy - self.eye.rest).astype(np.float32)
        field = np.matmul(self._spread, moved).transpose(0, 2, 1)
        shape = (len(images), 2, self.cells, self.cells)
        return np.ascontiguousarray(field).reshape(shape)

    @property
    def symmetric(self) -> tuple[bool, bool]:
        """Whether the pins at rest are their own mirror image with x, and with y, reversed."""
        pins, last = self.eye.rest, self.eye.side - 1
        return _same(pins, np.abs([last, 0] - pins)), _same(pins, np.abs([0, last] - pins))

    def plain(self) -> dict[str, str | int]:
        """JSON values from which ``of_plain`` makes the same field."""
        return {"rest": pack_image(self.eye.still), "cells": self.cells}

    @classmethod
    def of_plain(cls, values: dict[str, str | int]) -> Self:
        return cls(Eye.at(unpack_image(str(values["rest"]))), int(values["cells"]))


def _same(pins: npt.NDArray[np.float64], mirrored: npt.NDArray[np.float64]) -> bool:
    distance, _ = cKDTree(pins).query(mirrored)
    return bool(np.sqrt(np.square(distance).mean()) < _SYMMETRIC_PX)
