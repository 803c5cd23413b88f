"""The network of ``mixture``: from a displacement field to raw outputs of coarse cells."""

from __future__ import annotations

import math

import torch
from torch import nn
from torch.nn import functional as F  # noqa: N812

from tactibench.training import draw_flips, flip_maps

CHANNELS = 7
"""Raw outputs of a cell, as ``tactibench.training.mixture_values`` reads them."""
_FIRST_LOG_STD = 0.3
"""Log std of a cell before anything is learned, log mm."""
_PRESENCE_GAIN = 4.0
"""Factor on the logit of presence. This logit has the longest way to go, but an optimiser that
divides by the size of the gradients (Adam) moves all weights at the same pace."""


class MixtureNetwork(nn.Module):
    """(B, 2, 2 n, 2 n) displacement of the skin -> (B, 7, n, n) raw outputs of a mixture.

    Three levels of n, n / 2 and n / 4 cells, with residual blocks of two convolutions each and
    without normalisation: the statistics of a batch would be noise to a network that measures. Each
    block starts as the identity (as in Fixup, Zhang et al. 2019). The field enters with the
    coordinates of its cells, because a dome does not look the same from place to place.

    Args:
        width: Channels of the finest level.
        side: Cells along a side of the field, 2 n.
        mirror: Whether, in training, frames are mirrored at random with x, and with y, reversed,
            and the outputs mirrored back.
    """

    scale: torch.Tensor
    place: torch.Tensor

    def __init__(self, width: int, side: int, mirror: tuple[bool, bool]) -> None:
        super().__init__()
        self.mirror = mirror
        axis = torch.linspace(-1, 1, side)
        place = torch.stack(torch.meshgrid(axis, axis, indexing="xy"))[None]
        self.register_buffer("place", place, persistent=False)
        self.register_buffer("scale", torch.ones(()))
        deep = 2 * width
        self.stem = nn.Conv2d(4, width, 6, stride=2, padding=2)
        self.fine = Residual(width)
        self.down = nn.Conv2d(width, deep, 3, stride=2, padding=1)
        self.middle = Residual(deep)
        self.further_down = nn.Conv2d(deep, deep, 3, stride=2, padding=1)
        self.bottom = Residual(deep)
        self.lift = nn.ConvTranspose2d(deep, deep, 2, stride=2)
        self.middle_up = Residual(deep)
        self.further_lift = nn.ConvTranspose2d(deep, width, 2, stride=2)
        self.fine_up = Residual(width)
        self.widen = nn.Conv2d(width, deep, 1)
        self.head = Head(deep)

    @torch.no_grad()
    def initialise(self, fields: torch.Tensor, contacts: torch.Tensor) -> None:
        """Fix the scale to the training fields and start at their count of contacts.

        Args:
            fields: (N, 2, S, S) displacements, px.
            contacts: (N, K, 3) contacts, rows of NaN for none.
        """
        self.scale.copy_(1 / fields.square().mean().sqrt().clamp_min(1e-6))
        cells = self.place[0, 0].numel() / 4
        count = float((~contacts[..., 0].isnan()).sum()) / len(contacts)
        self.head.initialise(min(max(count, 0.1) / cells, 0.5))

    def forward(self, fields: torch.Tensor) -> torch.Tensor:
        if not self.training:
            return self._cells(fields)
        flips = draw_flips(len(fields), self.mirror, fields.device)
        signs = 1 - 2 * flips.to(fields.dtype)
        raw = flip_maps(self._cells(flip_maps(fields, flips) * signs[:, :, None, None]), flips)
        steps = raw[:, 1:3] * signs[:, :, None, None]
        return torch.cat([raw[:, :1], steps, raw[:, 3:]], dim=1)

    def _cells(self, fields: torch.Tensor) -> torch.Tensor:
        place = self.place.expand(len(fields), -1, -1, -1)
        fine = self.fine(self.stem(torch.cat([fields * self.scale, place], dim=1)))
        middle = self.middle(self.down(F.relu(fine)))
        bottom = self.bottom(self.further_down(F.relu(middle)))
        middle = self.middle_up(middle + self.lift(F.relu(bottom)))
        fine = self.fine_up(fine + self.further_lift(F.relu(middle)))
        raw: torch.Tensor = self.head(F.relu(self.widen(F.relu(fine))))
        return raw


class Residual(nn.Module):
    """x + conv(relu(conv(relu(x)))), the identity at first."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(width, width, 3, padding=1)
        self.second = nn.Conv2d(width, width, 3, padding=1)
        nn.init.kaiming_normal_(self.first.weight, nonlinearity="relu")
        nn.init.zeros_(self.second.weight)
        for convolution in (self.first, self.second):
            assert convolution.bias is not None  # noqa: S101
            nn.init.zeros_(convolution.bias)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        changed: torch.Tensor = x + self.second(F.relu(self.first(F.relu(x))))
        return changed


class Head(nn.Module):
    """Linear layer to the raw outputs, in float32 also within autocast.

    bf16 has 8 bits: it would round a depth of 6 mm to 0.02 mm.
    """

    gain: torch.Tensor

    def __init__(self, width: int) -> None:
        super().__init__()
        gain = torch.ones(CHANNELS, 1)
        gain[0] = _PRESENCE_GAIN
        self.register_buffer("gain", gain, persistent=False)
        self.weight = nn.Parameter(0.3 / math.sqrt(width) * torch.randn(CHANNELS, width) / gain)
        self.bias = nn.Parameter(torch.zeros(CHANNELS))

    @torch.no_grad()
    def initialise(self, presence: float) -> None:
        """Set the probability of a contact with which every cell begins."""
        self.bias.zero_()
        self.bias[0] = math.log(presence / (1 - presence)) / _PRESENCE_GAIN
        self.bias[4:] = _FIRST_LOG_STD

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        with torch.autocast(x.device.type, enabled=False):
            weight = (self.gain * self.weight)[:, :, None, None]
            return F.conv2d(x.float(), weight, self.gain[:, 0] * self.bias)
