"""Several dense networks in one: all members take a batch in one product a layer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional as F  # noqa: N812

from tactibench_pins.components import Components

_LAST = 0.1
"""Of the usual size of the last layer's first weights: answers start near the mean."""


class Members(nn.Module):
    """(B, 2 P) displacements, px -> (B, M, T) normalised targets of every member.

    The displacements are first turned into K whitened components. While it trains, every member
    sees them with noise of its own, as if every pin had been found that much elsewhere. Hidden
    layers after the first are residual: h <- (h + gelu(W h + b)) / sqrt 2.
    """

    mean: torch.Tensor
    basis: torch.Tensor
    noise: torch.Tensor

    def __init__(self, pins: int, sizes: Sequence[int], members: int) -> None:
        """sizes: K, units of the hidden layers, T."""
        super().__init__()
        self.members = members
        self.register_buffer("mean", torch.zeros(2 * pins))
        self.register_buffer("basis", torch.zeros(2 * pins, sizes[0]))
        self.register_buffer("noise", torch.zeros(sizes[0]))
        self.weights = nn.ParameterList()
        self.biases = nn.ParameterList()
        for number, (inside, outside) in enumerate(pairwise(sizes)):
            last = number == len(sizes) - 2
            size = math.sqrt(2 / inside) * (_LAST if last else 1.0)
            self.weights.append(nn.Parameter(size * torch.randn(members, inside, outside)))
            self.biases.append(nn.Parameter(torch.zeros(members * outside)))  # no weight decay

    @torch.no_grad()
    def start_from(self, components: Components, whitening: float, noise_px: float) -> None:
        """Fix what the displacements are turned into. noise_px: of one coordinate of a pin."""
        weights = torch.from_numpy(components.weights(whitening)).float()
        found = len(components)  # frames that hardly differ have fewer than K
        self.mean.copy_(torch.from_numpy(components.mean))
        self.basis[:, :found] = torch.from_numpy(components.basis).float() * weights
        self.noise[:found] = noise_px * weights

    def forward(self, moved: torch.Tensor) -> torch.Tensor:
        hidden = ((moved - self.mean) @ self.basis).expand(self.members, -1, -1)
        if self.training:
            hidden = hidden + self.noise * torch.randn_like(hidden)
        last = len(self.weights) - 1
        for number, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            raw = torch.baddbmm(bias.view(self.members, 1, -1), hidden, weight)
            if number == last:
                return raw.transpose(0, 1)
            hidden = F.gelu(raw) if number == 0 else (hidden + F.gelu(raw)) * math.sqrt(0.5)
        raise AssertionError("a network has a last layer")
