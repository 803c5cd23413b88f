"""The model ``pins``: frames -> displacements of the pins -> averaged networks -> one answer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from tactibench import Answer, Frame, ModelContext
from tactibench.superposition import Eye
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
    vector_answers,
)
from tactibench_pins.architecture import Members
from tactibench_pins.components import Components
from tactibench_pins.eye import displacements, eye_of

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


class Pins(LearnedModel):
    """Regression of one answer from where all pins went: exactly one for every frame.

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
        super().__init__(context, RECIPE.with_choices(epochs, precision), architecture)
        self._eye: Eye | None = None
        self._pins = self._components = 1
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
        self._eye = eye_of(frames, known)
        self._pins = len(self._eye.rest)
        self._components = min(_COMPONENTS, 2 * self._pins, max(1, len(frames) - 1))

    def start(self, network: Members, training: Examples) -> None:
        found = Components.fit(training.images.double().numpy(), self._components)
        network.start_from(found, _WHITENING, _NOISE_PX)

    def inputs(self, frames: Sequence[Frame]) -> torch.Tensor:
        return torch.from_numpy(displacements(self._eye, frames, self.name)).float()

    def targets(self, truth: Sequence[Answer]) -> torch.Tensor:
        known = answer_vectors(truth, self.context.answer, self.name)
        return torch.from_numpy(self._scale.apply(known)).float()

    def loss(self, outputs: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        return (outputs - targets[:, None]).abs().mean()

    def outputs(self, raw: torch.Tensor) -> npt.NDArray[Any]:
        """(B, T) mean over the members, in mm and deg."""
        return self._scale.invert(raw.float().mean(dim=1).cpu().numpy())

    def answers(self, outputs: npt.NDArray[Any]) -> list[Answer | None]:
        return vector_answers(outputs, self.context.answer)

    def extra(self) -> dict[str, Any]:
        return {
            "rest": None if self._eye is None else pack_image(self._eye.still),
            "components": self._components,
            "scale": self._scale.plain(),
        }

    def use_extra(self, extra: dict[str, Any]) -> None:
        self._eye = None if extra["rest"] is None else Eye.at(unpack_image(extra["rest"]))
        self._pins = 1 if self._eye is None else len(self._eye.rest)
        self._components = extra["components"]
        self._scale = Normalisation.of_plain(extra["scale"])
