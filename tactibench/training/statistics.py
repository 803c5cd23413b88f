"""The statistics of batch normalisation that prediction uses, measured where they are needed.

Averaged weights have none of their own, and running averages over the last few batches would stay
in the predictions of a network that reads an absolute depth as a bias. So they are measured over
many frames ("precise" batch normalisation, Wu and Johnson 2021, Rethinking "Batch" in BatchNorm).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import torch
from torch import nn


def _normalisations(network: nn.Module) -> list[nn.modules.batchnorm._BatchNorm]:
    kind = nn.modules.batchnorm._BatchNorm
    return [module for module in network.modules() if isinstance(module, kind)]


@torch.no_grad()
def measure_statistics(
    network: nn.Module,
    batches: Iterable[torch.Tensor],
    outputs: Callable[[nn.Module, torch.Tensor], torch.Tensor],
) -> None:
    """Replace the running statistics by plain means over batches of images.

    outputs(network, images): the forward pass, in the arithmetic of the training; it is not called
    where nothing normalises by its batch.
    """
    found = _normalisations(network)
    if not found:
        return
    usual = [module.momentum for module in found]
    for module in found:
        module.reset_running_stats()
        module.momentum = None
        module.train()
    for images in batches:
        outputs(network, images)
    for module, momentum in zip(found, usual, strict=True):
        module.momentum = momentum
