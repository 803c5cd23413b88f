"""Several dense networks in one: all members take a batch in one product a layer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional as F  # noqa: N812

from tactibench_pins.displacements import FAINT, Components
from tactibench_pins.transfer import Differences

_LAST = 0.1
"""Factor on the usual size of the last layer's first weights, so that answers start near the
mean."""


def torch_polar(moved: torch.Tensor) -> torch.Tensor:
    """Return ``polar`` of a tensor (..., C)."""
    size = moved.square().mean(dim=-1, keepdim=True).sqrt().clamp_min(FAINT)
    return torch.cat([moved / size, 2 * size.log()], dim=-1)


class Members(nn.Module):
    """Networks from (B, 2 P) displacements, px, to (B, M, T + 1) targets and rms displacement.

    The displacements are first turned into K whitened components. While it trains, every member
    sees them with noise of its own, as if every pin had been found that much elsewhere. Hidden
    layers after the first are residual: h <- (h + gelu(W h + b)) / sqrt 2. With
    ``show_differences`` each frame is also shown as other sensors might see it.
    """

    mean: torch.Tensor
    basis: torch.Tensor
    noise: torch.Tensor
    differences: torch.Tensor

    def __init__(self, size: int, sizes: Sequence[int], members: int, polar: bool = False) -> None:
        """Make ``members`` networks.

        Args:
            size: Numbers of a frame, 2 P.
            sizes: K, units of the hidden layers, T.
            members: M.
            polar: Whether vectors are taken as direction and size.
        """
        super().__init__()
        self.members = members
        self.polar = polar
        self.channel_noise = 0.0
        size += polar
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("basis", torch.zeros(size, sizes[0]))
        self.register_buffer("noise", torch.zeros(sizes[0]))
        self.register_buffer("differences", torch.zeros(0, 0), persistent=False)
        self.weights = nn.ParameterList()
        self.biases = nn.ParameterList()
        for number, (inside, outside) in enumerate(pairwise(sizes)):
            last = number == len(sizes) - 2
            spread = math.sqrt(2 / inside) * (_LAST if last else 1.0)
            self.weights.append(nn.Parameter(spread * torch.randn(members, inside, outside)))
            self.biases.append(nn.Parameter(torch.zeros(members * outside)))  # no weight decay

    @torch.no_grad()
    def initialise(self, components: Components, whitening: float, noise: float) -> None:
        """Fix the components of displacements.

        Args:
            components: Components of the training frames.
            whitening: Power of the spreads, see ``Components.weights``.
            noise: Deviation of one number of a frame.
        """
        weights = torch.from_numpy(components.weights(whitening)).float()
        count = len(components)  # frames that hardly differ have fewer than K
        self.mean.copy_(torch.from_numpy(components.mean))
        self.basis[:, :count] = torch.from_numpy(components.basis).float() * weights
        if self.polar:  # channels are noisy, not their directions
            self.channel_noise = noise
        else:
            self.noise[:count] = noise * weights

    @torch.no_grad()
    def show_differences(self, differences: Differences) -> None:
        """Show smooth differences of fields in the training; to be called after ``initialise``."""
        factor = differences.of_components(self.basis.cpu().double().numpy())
        self.differences = torch.from_numpy(factor).to(self.basis)

    def forward(self, moved: torch.Tensor) -> torch.Tensor:
        hidden = self.hidden(moved)
        bias = self.biases[-1].view(self.members, 1, -1)
        values = torch.baddbmm(bias, hidden, self.weights[-1]).transpose(0, 1)
        rms = moved.square().mean(dim=1).sqrt()[:, None, None].expand(-1, self.members, 1)
        return torch.cat([values, rms.to(values)], dim=2)

    def hidden(self, moved: torch.Tensor) -> torch.Tensor:
        """Return the last hidden layer (M, B, U) of every member."""
        if self.polar:
            vectors = moved.expand(self.members, -1, -1)
            if self.training:
                vectors = vectors + self.channel_noise * torch.randn_like(vectors)
            hidden = (torch_polar(vectors) - self.mean) @ self.basis
        else:
            hidden = ((moved - self.mean) @ self.basis).expand(self.members, -1, -1)
        if self.training:
            hidden = hidden + self.noise * torch.randn_like(hidden)
            if len(self.differences):
                rms = moved.square().mean(dim=1).sqrt()[:, None]
                hidden = hidden + rms * (torch.randn_like(hidden) @ self.differences.T)
        for number, (weight, bias) in enumerate(
            zip(self.weights[:-1], self.biases[:-1], strict=True)
        ):
            raw = F.gelu(torch.baddbmm(bias.view(self.members, 1, -1), hidden, weight))
            hidden = raw if number == 0 else (hidden + raw) * math.sqrt(0.5)
        return hidden
