"""A conventional TacTip CNN: convolution and pooling blocks, then dense layers."""

from __future__ import annotations

import math

import torch
from torch import nn

from tactibench.training import relight

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
