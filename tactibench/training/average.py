"""Weights averaged over the steps of a training: what predicts well while the rate is still high.

Steps at a high learning rate circle the minimum that they have reached; their mean lies inside the
circle (Polyak and Juditsky 1992; for networks Izmailov et al. 2018, "Averaging weights leads to
wider optima and better generalization").
"""

from __future__ import annotations

from typing import Any

import torch
from torch import nn
from torch.optim.swa_utils import AveragedModel

_SOON = 10
"""The mean of the first n steps reaches back over a ninth of them: it leaves the start behind."""


def averaged(network: nn.Module, decay: float) -> AveragedModel:
    """An exponential moving average, with this decay a step, of a network's weights.

    ``update_parameters`` takes in a step. ``module`` is a network with the mean weights; the
    statistics of batch normalisation in it are those of the last step until they are measured.
    """

    def toward(mean: Any, weights: Any, count: torch.Tensor | int) -> None:
        steps = int(count)
        kept = min(decay, (1 + steps) / (_SOON + steps))
        torch._foreach_lerp_(mean, weights, 1 - kept)

    mean = AveragedModel(network, multi_avg_fn=toward)
    return mean.eval().requires_grad_(requires_grad=False)
