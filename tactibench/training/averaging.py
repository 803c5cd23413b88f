"""Weights averaged over the steps of a training, and the batch statistics that such weights need.

Steps at a high learning rate circle the minimum that they have reached; their mean lies inside the
circle (Polyak and Juditsky 1992; for networks Izmailov et al. 2018, "Averaging weights leads to
wider optima and better generalization"). Averaged weights have no statistics of batch normalisation
of their own, and running averages over the last few batches would stay in the predictions of a
network that reads an absolute depth as a bias. So they are measured over many frames ("precise"
batch normalisation, Wu and Johnson 2021, Rethinking "Batch" in BatchNorm).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import torch
from torch import nn
from torch.nn.modules.batchnorm import _BatchNorm
from torch.optim.swa_utils import AveragedModel

_RAMP = 10
"""The mean of the first n steps reaches back over a ninth of them: it leaves the start behind."""


def average_weights(network: nn.Module, decay: float) -> AveragedModel:
    """Return an exponential moving average, with this decay a step, of a network's weights.

    ``update_parameters`` takes in a step. ``module`` is a network with the mean weights; the
    statistics of batch normalisation in it are those of the last step until they are measured.
    """

    def update(mean: Any, weights: Any, count: torch.Tensor | int) -> None:
        steps = int(count)
        share = min(decay, (1 + steps) / (_RAMP + steps))
        torch._foreach_lerp_(mean, weights, 1 - share)

    mean = AveragedModel(network, multi_avg_fn=update)
    return mean.eval().requires_grad_(requires_grad=False)


@torch.no_grad()
def measure_statistics(
    network: nn.Module,
    batches: Iterable[torch.Tensor],
    forward: Callable[[nn.Module, torch.Tensor], torch.Tensor],
) -> None:
    """Replace the running statistics of batch normalisation by plain means over batches of images.

    Args:
        network: changed in place; nothing happens where it does not normalise by its batch.
        batches: of images.
        forward: forward(network, images), the pass in the arithmetic of the training.
    """
    layers = [module for module in network.modules() if isinstance(module, _BatchNorm)]
    if not layers:
        return
    momenta = [layer.momentum for layer in layers]
    for layer in layers:
        layer.reset_running_stats()
        layer.momentum = None
        layer.train()
    for images in batches:
        forward(network, images)
    for layer, momentum in zip(layers, momenta, strict=True):
        layer.momentum = momentum
