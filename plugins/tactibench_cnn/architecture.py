"""A conventional TacTip CNN: convolution and pooling blocks, then dense layers."""

from __future__ import annotations

import torch
from torch import nn

_SIDE = 4
"""Cells a side that the convolutions leave for the dense layers."""


class CNNNetwork(nn.Module):
    """(B, 1, S, S) uint8 frames -> (B, outputs) normalised targets.

    Blocks of 3x3 convolutions, batch normalisation, ReLU and 2x2 max pooling down to 4x4 cells
    (the first block of one convolution, the others of two), then two dense layers, after the
    networks of Lepora et al. for the TacTip.
    """

    mean: torch.Tensor
    scale: torch.Tensor

    def __init__(self, width: int, size: int, hidden: int, outputs: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(()))
        self.register_buffer("scale", torch.ones(()))
        layers: list[nn.Module] = []
        channels, side, block = 1, size, 0
        while side >= 2 * _SIDE:
            wide = width * 2 ** min(block, 3)
            layers += _convolution(channels, wide)
            layers += [*_convolution(wide, wide)] if block else []
            layers.append(nn.MaxPool2d(2))
            channels, side, block = wide, side // 2, block + 1
        self.features = nn.Sequential(*layers)
        self.head = nn.Sequential(
            nn.Flatten(),
            nn.Linear(channels * side * side, hidden),
            nn.ReLU(inplace=True),
            nn.Linear(hidden, outputs),
        )

    @torch.no_grad()
    def start_from(self, images: torch.Tensor) -> None:
        """Fix the input scale to the training frames (uint8)."""
        values = images.float()
        self.mean.copy_(values.mean())
        self.scale.copy_(1 / values.std(correction=0).clamp_min(1.0))

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        normal: torch.Tensor = self.head(self.features((images.float() - self.mean) * self.scale))
        return normal


def _convolution(channels: int, width: int) -> list[nn.Module]:
    return [
        nn.Conv2d(channels, width, 3, padding=1, bias=False),
        nn.BatchNorm2d(width),
        nn.ReLU(inplace=True),
    ]
