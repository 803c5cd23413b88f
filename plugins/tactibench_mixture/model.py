"""The model ``mixture``: frames -> displacement field -> mixture of Gaussians -> contacts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from tactibench import (
    Answer,
    Contacts,
    FitReport,
    Frame,
    Grid,
    ModelContext,
    Progress,
    UserError,
)
from tactibench.superposition import Eye
from tactibench.training import (
    Examples,
    LearnedModel,
    MixtureScale,
    PlateScale,
    Recipe,
    held_back,
    mixture_loss,
    mixture_values,
    pack_contacts,
    scale_std,
    std_factors,
)
from tactibench_mixture.architecture import CHANNELS, MixtureNetwork
from tactibench_mixture.displacement import DisplacementField

RECIPE = Recipe(
    epochs=30, batch=32, learning_rate=2e-3, warmup=0.2, weight_decay=1e-2, precision="float32"
)
_FINER = 2
"""Cells of the displacement field along a cell of the mixture."""
_REACH = 0.75
"""Cells that a contact may lie from the centre of the cell that speaks of it, in x and in y. The
nearest cell needs half a cell; the further others reach, the later they agree on who speaks."""
_AS_STATED = np.ones((2, 3))


class Mixture(LearnedModel):
    """Each of some coarse cells says with which probability it holds a contact, where and how deep
    that is, and how sure it is; trained by the likelihood of the true contacts (compare DECODE,
    Speiser et al. 2021).

    What goes in is the displacement field of the pins, tracked from the rest image of the first
    training frame or from the frame that is pressed least. The stated std are scaled so that 95 %
    of the errors on validation frames lie inside the 95 % ellipses.

    Raises UserError without an encoder of this kind and for a grid that ``cells`` do not divide.
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
        self._centres = torch.from_numpy(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
        self._scale = MixtureScale(_REACH * self._grid.pitch, context.max_depth)
        self._plate = PlateScale()
        self._factors = _AS_STATED
        self._field: DisplacementField | None = None

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: tuple[Sequence[Frame], Sequence[Answer]],
        rng: np.random.Generator,
        progress: Progress,
    ) -> FitReport:
        """Train, then scale the std. Frames with several contacts are kept back for the latter:
        one of twenty of those given, and as many new mixtures as validation frames if it mixes."""
        used, kept = held_back(truth)
        seen = [*validation[0], *(frames[row] for row in kept)]
        known = [*validation[1], *(truth[row] for row in kept)]
        report = super().fit(
            [frames[row] for row in used],
            [truth[row] for row in used],
            validation=(seen, known),
            rng=rng,
            progress=progress,
        )
        if self.mixing and seen:
            from tactibench.superposition import mix

            mixed, contacts = mix(frames, truth, len(seen), rng)
            seen, known = [*seen, *mixed], [*known, *contacts]
        if seen:
            found = self._read(self.evaluate(seen))
            self._factors = std_factors(found, [self._plate.contacts(one) for one in known])
        notes = {"kept_for_std": len(kept), "std_factors": self._factors.round(4).tolist()}
        return replace(report, notes={**report.notes, **notes})

    def prepare(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:
        self._factors = _AS_STATED
        self._plate = PlateScale.of(truth, self.context.max_depth)
        contacts = [self._plate.contacts(answer) for answer in truth]
        least = int(np.argmin([one.depth.sum() for one in contacts]))
        eye = Eye.of(frames, otherwise=frames[least])
        self._field = DisplacementField(eye, _FINER * self._cells)

    def build(self) -> MixtureNetwork:
        mirror = (False, False)
        if self._field is not None and self.architecture["mirror"] == "auto":
            mirror = self._field.symmetric
        return MixtureNetwork(self.architecture["width"], _FINER * self._cells, mirror)

    def start(self, network: MixtureNetwork, training: Examples) -> None:
        network.start_from(training.images, training.targets)

    def inputs(self, frames: Sequence[Frame]) -> torch.Tensor:
        if self._field is None:
            raise UserError("model 'mixture' knows no pins yet; train it or load weights first.")
        return torch.from_numpy(self._field(self._field.eye.images(frames)))

    def targets(self, truth: Sequence[Answer]) -> torch.Tensor:
        return pack_contacts([self._plate.contacts(answer) for answer in truth])

    def loss(self, outputs: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        centres = self._centres.to(outputs)
        return mixture_loss(outputs.flatten(2), centres, targets, self._scale)

    def outputs(self, raw: torch.Tensor) -> np.ndarray:
        """(N, 7, cells, cells) float32 maps as the encoder reads them."""
        centres = self._centres.to(raw.device, torch.float32)
        presence, mean, std = mixture_values(raw.flatten(2), centres, self._scale)
        offset, depth = mean[..., :2] - centres, mean[..., 2:]
        maps = torch.cat([presence[..., None], offset, depth, std], dim=-1)
        return super().outputs(maps.transpose(1, 2).reshape(len(raw), CHANNELS, *self._grid.shape))

    def answers(self, outputs: np.ndarray) -> list[Answer | None]:
        """Contacts of every frame, or its plate pose (None where there is no contact)."""
        found = [scale_std(contacts, self._factors) for contacts in self._read(outputs)]
        if self.context.answer == "plate":
            return [self._plate.plate(contacts) for contacts in found]
        return list(found)

    def extra(self) -> dict[str, Any]:
        field = None if self._field is None else self._field.plain()
        return {
            "depth_offset_mm": self._plate.offset,
            "std_factors": self._factors.tolist(),
            "field": field,
        }

    def use_extra(self, extra: dict[str, Any]) -> None:
        self._plate = PlateScale(extra["depth_offset_mm"])
        self._factors = np.array(extra["std_factors"])
        self._field = None if extra["field"] is None else DisplacementField.of_plain(extra["field"])

    @property
    def _cells(self) -> int:
        return int(self.architecture["cells"])

    def _read(self, maps: np.ndarray) -> list[Contacts]:
        """Contacts with the std as the network states it."""
        return self._encoder.decode_batch(maps, self._grid)


def _coarse(grid: Grid, cells: int) -> Grid:
    """A grid of cells x cells over the same square."""
    rows, columns = grid.shape
    if rows != columns or rows % cells:
        raise UserError(
            f"model 'mixture' needs a square grid whose side is a multiple of {cells} cells, not "
            f"{grid.shape}; change the protocol's grid or --param model.cells."
        )
    each = rows // cells
    x, y = (start + 0.5 * (each - 1) * grid.pitch for start in grid.origin)
    return Grid((cells, cells), (x, y), each * grid.pitch)
