"""The model ``cnn``: frames -> one contact or one plate pose, by regression.

A conventional TacTip CNN: convolution and pooling blocks, then dense layers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from scipy.special import expit
from torch import nn
from torch.nn import functional as F  # noqa: N812

from tactibench import Answer, Contacts, Frame, ModelContext
from tactibench.markers import AlignedImages
from tactibench.training import (
    ANSWER_WIDTH,
    RECIPES,
    Examples,
    LearnedModel,
    Normalisation,
    answer_vectors,
    answers_from_vectors,
    image_tensor,
    pack_image,
    regression_rows,
    relight,
    resting_frames,
    unpack_image,
)

_SIDE = 4
"""Fewest cells along a side that the convolutions leave for the dense layers."""


class CNNNetwork(nn.Module):
    """(B, images, S, S) uint8 -> (B, values) normalised targets, and the logit of a presence.

    A 5x5 convolution of stride 2, then blocks of 3x3 convolution, batch normalisation, ReLU and
    2x2 max pooling with doubling channels until 4 to 7 cells a side are left, then two dense
    layers: the shape of the regression networks that are usual for the TacTip.

    Args:
        width: Channels of the first block.
        size: Side of the frames S, px.
        hidden: Units of the dense layer.
        values: Number of targets.
        presence: Whether there is an output for the logit of a presence.
        images: Images of a frame: 1, itself; 2, itself in the light of the sensor at rest, and the
            sensor at rest.
    """

    mean: torch.Tensor
    scale: torch.Tensor

    def __init__(
        self, width: int, size: int, hidden: int, values: int, presence: bool, images: int = 1
    ) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(()))
        self.register_buffer("scale", torch.ones(()))
        layers = _convolution(images, width, kernel=5, stride=2)
        channels, side, block = width, (size + 1) // 2, 1
        while side >= 2 * _SIDE:
            wide = width * 2 ** min(block, 3)
            layers += [*_convolution(channels, wide), nn.MaxPool2d(2)]
            channels, side, block = wide, side // 2, block + 1
        self.features = nn.Sequential(*layers)
        self.head = nn.Sequential(
            nn.Flatten(),
            nn.Linear(channels * side * side, hidden),
            nn.ReLU(inplace=True),
            nn.Linear(hidden, values + presence),
        )
        self.presence = presence

    @torch.no_grad()
    def initialise(self, images: torch.Tensor, with_contact: int, without: int) -> None:
        """Fix the input scale to the training frames, and the first presence to their share.

        One frame with and one without a contact are added (Laplace's rule).

        Args:
            images: (N, images, S, S) uint8 frames.
            with_contact: Number of frames with a contact.
            without: Number of frames without a contact.
        """
        values = images.float()
        self.mean.copy_(values.mean())
        self.scale.copy_(1 / values.std(correction=0).clamp_min(1.0))
        if self.presence:
            last = self.head[-1]
            assert isinstance(last, nn.Linear)  # noqa: S101
            last.bias[-1] = math.log((with_contact + 1) / (without + 1))

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        images = images.float()
        if images.shape[1] > 1:
            images = relight(images)
        normal: torch.Tensor = self.head(self.features((images - self.mean) * self.scale))
        return normal


def _convolution(channels: int, width: int, kernel: int = 3, stride: int = 1) -> list[nn.Module]:
    return [
        nn.Conv2d(channels, width, kernel, stride=stride, padding=kernel // 2, bias=False),
        nn.BatchNorm2d(width),
        nn.ReLU(inplace=True),
    ]


_RECIPES = RECIPES | {
    "default": replace(RECIPES["default"], epochs=11, optimiser="muon", learning_rate=6e-3)
}
"""As many epochs as fit into eight minutes on one core of an AMD EPYC; 8 epochs at a learning rate
of 4e-3 end 7 % worse."""
_HIDDEN = 128
"""Units of the dense layer."""
_RESTING_SHARE = 0.05
"""Frames at rest that are added to a training, as a share of its frames."""
_PRESENT = 0.5
"""Probability from which a contact is reported."""


class CNN(LearnedModel):
    """Regression baseline: a contact and the probability that there is one, or a plate pose.

    It sees the frame in the light of the sensor at rest, and the sensor at rest beside it. From the
    rest images of the frames, and from training frames without contact, it learns that there may be
    no contact. A frame with several contacts is refused.
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
        values = ANSWER_WIDTH[context.answer]
        self._normalisation = Normalisation(np.zeros(values), np.ones(values))
        self._as_published = recipe == "paper"
        self._aligned: AlignedImages | None = None

    @property
    def _contacts(self) -> bool:
        return bool(self.context.answer == "contacts")

    def build(self) -> CNNNetwork:
        shape = self.architecture
        values = ANSWER_WIDTH[shape["answer"]]
        images = 1 if self._aligned is None else 2
        return CNNNetwork(
            shape["width"], shape["size"], shape["hidden"], values, self._contacts, images
        )

    def inputs(self, frames: Sequence[Frame]) -> torch.Tensor:
        """Return (N, 1 or 2, S, S) uint8: the frames and, where it is shown, the sensor at rest.

        Frames of another sensor are then seen on the layout of the first training frame's sensor.
        """
        if self._aligned is None:
            return image_tensor(frames, self.architecture["size"])
        return torch.from_numpy(self._aligned(frames))

    def empty_frames(self, frames: Sequence[Frame]) -> list[Frame]:
        return resting_frames(frames, _RESTING_SHARE) if self._contacts else []

    def targets(self, truth: Sequence[Answer]) -> torch.Tensor:
        """Return targets (N, T) in standard deviations, rows of NaN where there is no contact."""
        values = answer_vectors(truth, self.context.answer, self.name)
        return torch.from_numpy(self._normalisation.apply(values)).float()

    def loss(self, outputs: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        """Return the Huber loss of the answers, plus the cross-entropy of a contact's presence.

        The knee is at a tenth of a deviation, because the metric is an absolute error.
        """
        present = ~targets.isnan().any(dim=1)
        values = outputs[:, : targets.shape[1]]
        error = F.huber_loss(values[present], targets[present], delta=0.1, reduction="sum")
        regression = error * 10 / max(1, int(present.sum()) * targets.shape[1])
        if not self._contacts:
            return regression
        return regression + F.binary_cross_entropy_with_logits(outputs[:, -1], present.float())

    def answers(self, outputs: np.ndarray) -> list[Answer | None]:
        values = self._normalisation.invert(outputs[:, : ANSWER_WIDTH[self.context.answer]])
        if not self._contacts:
            return answers_from_vectors(values, self.context.answer)
        presence = expit(outputs[:, -1].astype(np.float64))
        return [
            Contacts(row[np.newaxis, :2], row[2:], np.array([p]))
            if p >= _PRESENT
            else Contacts.none()
            for row, p in zip(values, presence, strict=True)
        ]

    def usable_rows(self, truth: Sequence[Answer]) -> npt.NDArray[np.int64]:
        rows = regression_rows(truth, self.context.answer, self.name)
        return super().usable_rows(truth) if self._contacts and len(rows) else rows

    def prepare(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:
        size = self.architecture["size"]
        self._aligned = None if self._as_published else AlignedImages.of(frames, size)
        values = answer_vectors(truth, self.context.answer, self.name)
        self._normalisation = Normalisation.of(values[np.isfinite(values).all(axis=1)])

    def initialise(self, network: CNNNetwork, training: Examples) -> None:
        present = ~training.targets.isnan().any(dim=1)
        network.initialise(training.images, int(present.sum()), int((~present).sum()))

    def extra(self) -> dict[str, Any]:
        rest = None if self._aligned is None else pack_image(self._aligned.rest)
        return {**self._normalisation.to_json(), "rest": rest}

    def restore(self, extra: dict[str, Any]) -> None:
        self._normalisation = Normalisation.from_json(extra)
        rest = extra["rest"]
        self._aligned = None if rest is None else AlignedImages(unpack_image(rest))
