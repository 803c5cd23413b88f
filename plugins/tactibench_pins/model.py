"""The model ``pins``: frames -> displacements of the pins -> averaged networks -> one answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import torch

from tactibench import Answer, Frame, ModelContext
from tactibench.training import (
    ANSWER_WIDTH,
    Examples,
    LearnedModel,
    Normalisation,
    Recipe,
    answer_vectors,
    pack_image,
    regressable,
    unpack_image,
)
from tactibench_pins.architecture import Members
from tactibench_pins.components import Components
from tactibench_pins.correction import Correction
from tactibench_pins.eye import LATTICE, Sight, displacements, sight, sight_at
from tactibench_pins.presence import answers_of, least
from tactibench_pins.views import views

Array = npt.NDArray[np.float64]

RECIPE = Recipe(
    epochs=300,
    batch=128,
    learning_rate=3e-3,
    warmup=0.2,
    weight_decay=1e-2,
    precision="float32",
)
_COMPONENTS = 40
"""Of the displacements; the next ones hold less than the pins' own noise on real frames."""
_WHITENING = 0.5
_NOISE_PX = 0.25
"""Twice what the centroid of a black and white pin is uncertain by."""
_LAYERS = 3

TRANSFER = replace(RECIPE, epochs=80)
"""Where other sensors are read, fewer epochs: what is learned last is the trained sensor's own."""
_SHARED = 12
"""Components where other sensors are read; the next ones differ more between two sensors of one
make than between two presses."""
_UNLIKE = 0.003
"""Noise in units of the layout where other sensors are read: what no view says of them."""
_VIEWS = 16
_BATCH = 32


class Pins(LearnedModel):
    """Regression of one answer from where all pins went; no contact where they hardly moved.

    A pin that was not seen stands where its neighbours say. The median is learned (the loss is the
    absolute error of the targets in standard deviations), by several networks that differ in
    their first weights and in the noise they are shown; the answer is their mean.
    """

    name = "pins"

    def __init__(
        self,
        context: ModelContext,
        members: int = 4,
        width: int = 256,
        epochs: int = 0,
        precision: str = "recipe",
    ) -> None:
        architecture = {"members": members, "width": width, "answer": context.answer}
        if context.transfers:
            architecture["transfers"] = True
        recipe = TRANSFER if context.transfers else RECIPE
        super().__init__(context, recipe.with_choices(epochs, precision), architecture)
        self._sight: Sight | None = None
        self._correction: Correction | None = None
        self._pins = self._components = 1
        self._least = 0.0
        count = ANSWER_WIDTH[context.answer]
        self._scale = Normalisation(np.zeros(count), np.ones(count))

    def build(self) -> Members:
        shape = self.architecture
        hidden = [shape["width"]] * _LAYERS
        sizes = [self._components, *hidden, ANSWER_WIDTH[self.context.answer]]
        return Members(self._pins, sizes, shape["members"])

    def usable(self, truth: Sequence[Answer]) -> npt.NDArray[np.int64]:
        return regressable(truth, self.context.answer, self.name)

    def prepare(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:
        known = answer_vectors(truth, self.context.answer, self.name)
        self._scale = Normalisation.of(known)
        self._sight = sight(frames, known, self.context.transfers)
        self._pins = self._sight.places
        most = _SHARED if self.context.transfers else _COMPONENTS
        self._components = min(most, 2 * self._pins, max(1, len(frames) - 1))

    def start(self, network: Members, training: Examples) -> None:
        moved = training.images.double().numpy()
        self._least = least(moved, self.context.answer)
        found = Components.fit(moved, self._components)
        transfers = self.context.transfers
        network.start_from(found, _WHITENING, _UNLIKE if transfers else _NOISE_PX)
        if transfers:  # the same views for every training seed
            network.show_through(views(LATTICE, _VIEWS, np.random.default_rng(0)))

    def inputs(self, frames: Sequence[Frame]) -> torch.Tensor:
        return torch.from_numpy(displacements(self._sight, frames, self.name)).float()

    def targets(self, truth: Sequence[Answer]) -> torch.Tensor:
        known = answer_vectors(truth, self.context.answer, self.name)
        return torch.from_numpy(self._scale.apply(known)).float()

    def loss(self, outputs: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        return (outputs[..., :-1] - targets[:, None]).abs().mean()

    def outputs(self, raw: torch.Tensor) -> npt.NDArray[Any]:
        """(B, T + 1) mean over the members, in mm and deg, and how far the pins went."""
        mean = raw.float().mean(dim=1).cpu().numpy()
        return np.column_stack([self._scale.invert(mean[:, :-1]), mean[:, -1]])

    def answers(self, outputs: npt.NDArray[Any]) -> list[Answer | None]:
        return answers_of(outputs, self.context.answer, self._least)

    def adapt(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> Mapping[str, Any]:
        """Correct the answers by what labelled frames of another sensor lack (``Correction``).

        Frames that cannot be learned from are left out; without any the answers are the trained
        ones. Returns what was chosen, for the record.
        """
        self._correction = None
        rows = self.usable(truth)
        if not len(rows):
            return {"frames": 0}
        known = self._scale.apply(answer_vectors(truth, self.context.answer, self.name)[rows])
        features, raw, _ = self._seen([frames[row] for row in rows])
        self._correction = Correction.fit(features, known - raw)
        return {"frames": len(rows), "ridge": list(self._correction.ridges)}

    def evaluate(self, frames: Sequence[Frame]) -> npt.NDArray[Any]:
        """(N, T + 1) answers in mm and deg, corrected by ``adapt``, and how far the pins went."""
        if self._correction is None:
            return super().evaluate(frames)
        features, raw, far = self._seen(frames)
        return np.column_stack([self._scale.invert(raw + self._correction(features)), far])

    @torch.inference_mode()
    def _seen(self, frames: Sequence[Frame]) -> tuple[Array, Array, Array]:
        """(N, M U) last hidden layers, (N, T) normalised answers, not corrected, and (N,) how far
        the pins went."""
        network = cast("Members", self.network)
        features, raw = [], []
        for start in range(0, len(frames), _BATCH):
            batch = self.inputs(frames[start : start + _BATCH]).to(self.context.device)
            hidden = network.hidden(batch)
            features.append(hidden.transpose(0, 1).flatten(1).double().cpu().numpy())
            raw.append(network(batch).mean(dim=1).double().cpu().numpy())
        found = np.concatenate(raw)
        return np.concatenate(features), found[:, :-1], found[:, -1]

    def extra(self) -> dict[str, Any]:
        return {
            "rest": None if self._sight is None else pack_image(self._sight.still),
            "components": self._components,
            "scale": self._scale.plain(),
            "least": self._least,
        }

    def use_extra(self, extra: dict[str, Any]) -> None:
        still = None if extra["rest"] is None else unpack_image(extra["rest"])
        self._sight = None if still is None else sight_at(still, self.context.transfers)
        self._pins = 1 if self._sight is None else self._sight.places
        self._components = extra["components"]
        self._scale = Normalisation.of_plain(extra["scale"])
        self._least = extra["least"]
