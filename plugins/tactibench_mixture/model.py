"""The model ``mixture``: frames -> displacement field -> mixture of Gaussians -> contacts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from tactibench import Answer, Contacts, Frame, Grid, ModelContext, UserError
from tactibench.markers import AlignedSensors
from tactibench.training import Examples, MixtureModel, Recipe
from tactibench_mixture.architecture import CHANNELS, MixtureNetwork
from tactibench_mixture.displacement import DisplacementField

RECIPE = Recipe(epochs=30, batch=32, learning_rate=2e-3, warmup=0.2, weight_decay=1e-2)
_FINER = 2
"""Cells of the displacement field along a cell of the mixture."""
_REACH = 0.75
"""Greatest distance, in cells, of a contact from the centre of the cell that reports it, in x and
in y. The nearest cell needs half a cell; the further the other cells reach, the later they agree on
which of them reports."""


class Mixture(MixtureModel):
    """A network that reports contacts cell by cell; compare DECODE (Speiser et al. 2021).

    Each of some coarse cells gives the probability that it holds a contact, where and how deep that
    contact is, and how sure the cell is. The input is the displacement field of the pins since
    their own rest image, on the layout of the first training frame's sensor (``AlignedSensors``).

    Raises:
        UserError: The encoder is not of kind mixture, or the grid is no square whose side is a
            multiple of ``cells``.
    """

    name = "mixture"

    def __init__(
        self,
        context: ModelContext,
        width: int = 32,
        cells: int = 16,
        mirror: str = "auto",
        epochs: int = 0,
        precision: str = "recipe",
        mixing: float = 0.0,
    ) -> None:
        if context.encoder is None or context.encoder.channels != CHANNELS:
            raise UserError("model 'mixture' needs an encoder of kind mixture; name one.")
        architecture = {"width": width, "cells": cells, "mirror": mirror, "answer": context.answer}
        super().__init__(context, RECIPE.with_choices(epochs, precision), architecture, mixing)
        self._encoder = context.encoder
        self._grid = _coarse(context.grid, cells)
        x, y = self._grid.axes()
        centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        self._use_anchors(centres, _REACH * self._grid.pitch)
        self._field: DisplacementField | None = None

    def prepare(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:
        super().prepare(frames, truth)
        self._sensors = self._find_sensors(frames, truth)
        self._field = DisplacementField(self._sensors.first, _FINER * self._cells)

    def build(self) -> MixtureNetwork:
        mirror = (False, False)
        if self._field is not None and self.architecture["mirror"] == "auto":
            mirror = self._field.symmetry
        return MixtureNetwork(self.architecture["width"], _FINER * self._cells, mirror)

    def initialise(self, network: MixtureNetwork, training: Examples) -> None:
        network.initialise(training.images, training.targets)

    def inputs(self, frames: Sequence[Frame]) -> torch.Tensor:
        tracks = self._tracks(frames)
        assert self._field is not None  # noqa: S101
        return torch.from_numpy(self._field(tracks))

    def outputs(self, raw: torch.Tensor) -> npt.NDArray[Any]:
        """Return (N, 7, cells, cells) float32 maps as the encoder reads them."""
        values = super().outputs(raw)
        values[..., 1:3] -= self._anchors.numpy()
        return values.transpose(0, 2, 1).reshape(len(raw), CHANNELS, *self._grid.shape)

    def read(self, outputs: npt.NDArray[Any]) -> list[Contacts]:
        return self._encoder.decode_batch(outputs, self._grid)

    def extra(self) -> dict[str, Any]:
        field = None if self._field is None else self._field.to_json()
        return {**super().extra(), "field": field}

    def restore(self, extra: dict[str, Any]) -> None:
        super().restore(extra)
        if extra["field"] is not None:
            self._field = DisplacementField.from_json(extra["field"])
            self._sensors = AlignedSensors(self._field.pins)

    @property
    def _cells(self) -> int:
        return int(self.architecture["cells"])


def _coarse(grid: Grid, cells: int) -> Grid:
    """Return a grid of cells x cells over the same square.

    Raises:
        UserError: The grid is no square whose side is a multiple of ``cells``.
    """
    rows, columns = grid.shape
    if rows != columns or rows % cells:
        raise UserError(
            f"model 'mixture' needs a square grid whose side is a multiple of {cells} cells, not "
            f"{grid.shape}; change the protocol's grid or --param model.cells."
        )
    each = rows // cells
    x, y = (start + 0.5 * (each - 1) * grid.pitch for start in grid.origin)
    return Grid((cells, cells), (x, y), each * grid.pitch)
