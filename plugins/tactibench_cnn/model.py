"""The model ``cnn``: frames -> one contact or one plate pose, by regression."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch.nn import functional as F  # noqa: N812

from tactibench import Answer, Frame, ModelContext
from tactibench.training import (
    ANSWER_WIDTH,
    RECIPES,
    Examples,
    LearnedModel,
    Normalisation,
    answer_vectors,
    image_tensor,
    regressable,
    vector_answers,
)
from tactibench_cnn.architecture import CNNNetwork

_RECIPES = RECIPES | {
    "default": replace(RECIPES["default"], epochs=16, optimiser="muon", learning_rate=4e-3)
}
"""Half the U-Net's learning rate; others were not tried with this optimiser."""
_HIDDEN = 128
"""Units of the dense layer."""


class CNN(LearnedModel):
    """Regression baseline: exactly one answer for every frame, score 1.

    Frames without contact have nothing to regress and are left out of a training; a frame with
    several contacts is refused.
    """

    name = "cnn"

    def __init__(
        self,
        context: ModelContext,
        recipe: str = "default",
        width: int = 16,
        size: int = 128,
        epochs: int = 0,
        precision: str = "recipe",
    ) -> None:
        architecture: dict[str, Any] = {
            "width": width,
            "size": size,
            "hidden": _HIDDEN,
            "answer": context.answer,
        }
        super().__init__(context, _RECIPES[recipe].with_choices(epochs, precision), architecture)
        outputs = ANSWER_WIDTH[context.answer]
        self._normalisation = Normalisation(np.zeros(outputs), np.ones(outputs))

    def build(self) -> CNNNetwork:
        shape = self.architecture
        return CNNNetwork(
            shape["width"], shape["size"], shape["hidden"], ANSWER_WIDTH[shape["answer"]]
        )

    def inputs(self, frames: Sequence[Frame]) -> torch.Tensor:
        return image_tensor(frames, self.architecture["size"])

    def targets(self, truth: Sequence[Answer]) -> torch.Tensor:
        known = answer_vectors(truth, self.context.answer, self.name)
        return torch.from_numpy(self._normalisation.apply(known)).float()

    def loss(self, outputs: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        """Huber with a knee at a tenth of a deviation: the metric is an absolute error."""
        return F.huber_loss(outputs, targets, delta=0.1) * 10

    def answers(self, outputs: np.ndarray) -> list[Answer | None]:
        return vector_answers(self._normalisation.invert(outputs), self.context.answer)

    def usable(self, truth: Sequence[Answer]) -> npt.NDArray[np.int64]:
        return regressable(truth, self.context.answer, self.name)

    def prepare(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:  # noqa: ARG002
        self._normalisation = Normalisation.of(
            answer_vectors(truth, self.context.answer, self.name)
        )

    def start(self, network: CNNNetwork, training: Examples) -> None:
        network.start_from(training.images)

    def extra(self) -> dict[str, Any]:
        return self._normalisation.plain()

    def use_extra(self, extra: dict[str, Any]) -> None:
        self._normalisation = Normalisation.of_plain(extra)
