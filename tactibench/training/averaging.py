"""Weights averaged over the steps of a training, and the batch statistics that such weights need.

Steps at a high learning rate circle the minimum that they have reached; their mean lies inside the
circle (Polyak and Juditsky 1992; for networks Izmailov et al. 2018, "Averaging weights leads to
wider optima and better generalization"). Averaged weights have no statistics of batch normalisation
of their own, and running averages over the last few batches would bias the predictions of a network
that reads an absolute depth. So the statistics are measured over many frames ("precise" batch
normalisation, Wu and Johnson 2021, Rethinking "Batch" in BatchNorm).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import torch
from torch import nn
from torch.nn.modules.batchnorm import _BatchNorm
from torch.optim.swa_utils import AveragedModel

_RAMP = 10
"""The mean after n steps reaches back over about a ninth of them, so it forgets the start."""


def average_weights(network: nn.Module, decay: float) -> AveragedModel:
    """Return an exponential moving average of a network's weights, with a decay per step.

    Its ``update_parameters`` adds the weights of a step. Its ``module`` is a network with the mean
    weights; the statistics of batch normalisation in it are those of the last step until they are
    measured.
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
        network: A network that is changed in place; nothing happens where it has no batch
            normalisation.
        batches: Batches of images.
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
