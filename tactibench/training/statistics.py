"""The statistics of batch normalisation that prediction uses, and a training that knows them.

A network that reads an absolute depth sees the statistics of its batch as noise, and the running
averages of the last few batches would stay in its predictions as a bias. So they are measured over
many frames once, near the end, and the last epochs train against them (compare "precise" and
"frozen" batch normalisation, Wu and Johnson 2021, Rethinking "Batch" in BatchNorm).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import torch
from torch import nn


def _normalisations(network: nn.Module) -> list[nn.modules.batchnorm._BatchNorm]:
    kind = nn.modules.batchnorm._BatchNorm
    return [module for module in network.modules() if isinstance(module, kind)]


def freeze_statistics(network: nn.Module) -> None:
    """Let the normalisations of a network in training mode use, and keep, what they have."""
    for module in _normalisations(network):
        module.eval()


@torch.no_grad()
def measure_statistics(
    network: nn.Module,
    batches: Iterable[torch.Tensor],
    outputs: Callable[[nn.Module, torch.Tensor], torch.Tensor],
) -> None:
    """Replace the running statistics by plain means over batches of images.

    outputs(network, images): the forward pass, in the arithmetic of the training.
    """
    found = _normalisations(network)
    usual = [module.momentum for module in found]
    for module in found:
        module.reset_running_stats()
        module.momentum = None
        module.train()
    for images in batches:
        outputs(network, images)
    for module, momentum in zip(found, usual, strict=True):
        module.momentum = momentum
