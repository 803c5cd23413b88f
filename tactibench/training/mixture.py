"""Contacts as a mixture of Gaussians: the outputs of a network per anchor, and their likelihood.

An anchor is a place that may report one contact: a cell of a coarse grid, or a node of a graph. It
gives a probability, a mean and standard deviations. The likelihood is that of localisation
microscopy (Speiser et al. 2021, Nature Methods 18:1082): contacts are drawn independently from the
mixture of the anchors' Gaussians, and their number from the anchors' probabilities.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch.nn import functional as F  # noqa: N812

from tactibench.contacts import Contacts

CHANNELS = 7
"""Raw outputs of an anchor: logit of presence, dx, dy, depth, log std of x, y and depth."""

_COUNT_VARIANCE = 1 / 12
"""Variance of a uniform distribution within half a count: a density is read at whole numbers
(Sheppard)."""
_LOG_STD = (-12.0, 4.0)
"""Bounds at which raw log std are cut off, so that neither exp nor its square leave float32."""


@dataclass(frozen=True)
class MixtureScale:
    """The lengths that turn raw outputs into mm.

    Attributes:
        reach_mm: Largest distance of a mean from its anchor, in x and in y.
        max_depth_mm: Depth for a raw depth of 1; a raw depth of -1 is 0 mm.
        floor_mm: Smallest standard deviation. It is below the noise of any sensor and only keeps
            the likelihood of a training frame finite.

    Raises:
        ValueError: A length is not positive.
    """

    reach_mm: float
    max_depth_mm: float
    floor_mm: float = 2e-3

    def __post_init__(self) -> None:
        if not min(self.reach_mm, self.max_depth_mm, self.floor_mm) > 0:
            raise ValueError("reach_mm, max_depth_mm and floor_mm must be positive")


def mixture_values(
    raw: torch.Tensor, anchors: torch.Tensor, scale: MixtureScale
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return probability (B, M), mean (B, M, 3) and std (B, M, 3) of x, y and depth, mm.

    Args:
        raw: (B, 7 or more, M) raw outputs, of which the first 7 channels are used.
        anchors: (M, 2) or (B, M, 2), mm.
        scale: Scale of the raw outputs.
    """
    mean, std = _gaussians(_exact(raw), anchors, scale)
    return _exact(raw)[:, 0].sigmoid(), mean, std


def mixture_loss(
    raw: torch.Tensor, anchors: torch.Tensor, contacts: torch.Tensor, scale: MixtureScale
) -> torch.Tensor:
    """Return the negative log likelihood of a frame's contacts, lengths in mm, mean over frames.

    With p_m, N_m of the anchors and n contacts c_k in a frame it is

        - sum_k log sum_m (p_m / sum p) N_m(c_k)  -  log N(n; sum p, sum p (1 - p) + 1 / 12)

    It is computed in float32 (float64 for a float64 raw), whatever the network computes in.

    Args:
        raw: (B, 7 or more, M) raw outputs, of which the first 7 channels are used.
        anchors: (M, 2) or (B, M, 2), mm.
        contacts: (B, K, 3) x, y, depth, mm; rows of NaN stand for no contact.
        scale: Scale of the raw outputs.
    """
    raw = _exact(raw)
    contacts = contacts.to(raw.dtype)
    present = ~contacts.isnan().any(dim=-1)
    mean, std = _gaussians(raw, anchors, scale)
    z = (contacts.nan_to_num()[:, :, None] - mean[:, None]) / std[:, None]
    log_gaussian = (
        -0.5 * z.square().sum(-1) - std.log().sum(-1)[:, None] - 1.5 * math.log(2 * math.pi)
    )
    log_p = F.logsigmoid(raw[:, 0])
    log_weight = log_p - log_p.logsumexp(dim=-1, keepdim=True)
    log_place = (log_weight[:, None] + log_gaussian).logsumexp(dim=-1)
    places = torch.where(present, log_place, 0.0).sum(-1)
    return (count_nll(raw[:, 0], present.sum(-1)) - places).mean()


def count_nll(logits: torch.Tensor, count: torch.Tensor) -> torch.Tensor:
    """Return the negative log probability of a count of independent draws, (B,), as a Gaussian's.

    The count of independent draws has the mean sum p and the variance sum p (1 - p).

    Args:
        logits: (B, M) logits of the probabilities p.
        count: (B,) counts.
    """
    p = logits.sigmoid()
    variance = (p * (-logits).sigmoid()).sum(-1) + _COUNT_VARIANCE
    away = count.to(p.dtype) - p.sum(-1)
    return 0.5 * (away.square() / variance + variance.log() + math.log(2 * math.pi))


def pack_contacts(truth: Sequence[Contacts]) -> torch.Tensor:
    """Return x, y, depth of contacts, mm, (N, K, 3) float32.

    K is the largest number of contacts, at least 1; a frame with fewer contacts has rows of NaN.
    """
    most = max([1, *(len(contacts) for contacts in truth)])
    packed = np.full((len(truth), most, 3), np.nan, dtype=np.float32)
    for row, contacts in zip(packed, truth, strict=True):
        row[: len(contacts), :2] = contacts.xy
        row[: len(contacts), 2] = contacts.depth
    return torch.from_numpy(packed)


def _exact(raw: torch.Tensor) -> torch.Tensor:
    return raw if raw.dtype == torch.float64 else raw.float()


def _gaussians(
    raw: torch.Tensor, anchors: torch.Tensor, scale: MixtureScale
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return mean and std (B, M, 3), mm, of raw outputs (B, 7 or more, M)."""
    xy = anchors.to(raw.dtype) + scale.reach_mm * raw[:, 1:3].tanh().transpose(1, 2)
    depth = 0.5 * scale.max_depth_mm * (1 + raw[:, 3, :, None])
    std = raw[:, 4:7].clamp(*_LOG_STD).exp().square().add(scale.floor_mm**2).sqrt()
    return torch.cat([xy, depth], dim=-1), std.transpose(1, 2)
