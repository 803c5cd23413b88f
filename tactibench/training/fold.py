"""A copy of a network for inference: batch normalisation folded, weights ready in their type."""

from __future__ import annotations

import copy
from itertools import pairwise

import torch
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval


def fold_batch_norm(network: nn.Module, precision: str = "float32") -> nn.Module:
    """Return a copy in evaluation mode in which each Conv2d takes over the BatchNorm2d after it.

    Pairs are looked for in nn.Sequential containers. In float32 the outputs are those of the
    network in evaluation mode up to rounding. For "bf16" the weights of the convolutions and dense
    layers are stored in bf16, which spares autocast, within which such a copy must be called, to
    cast them in every call; its outputs are those of the float32 copy under autocast.
    """
    folded = copy.deepcopy(network).eval()
    for module in folded.modules():
        if isinstance(module, nn.Sequential):
            _fold_pairs(module)
    if precision == "bf16":
        for module in folded.modules():
            if isinstance(module, nn.Conv2d | nn.ConvTranspose2d | nn.Linear):
                module.to(torch.bfloat16)
    return folded.to(memory_format=torch.channels_last)  # type: ignore[call-overload, no-any-return]


def _fold_pairs(layers: nn.Sequential) -> None:
    for index, (first, second) in enumerate(pairwise(list(layers))):
        if isinstance(first, nn.Conv2d) and isinstance(second, nn.BatchNorm2d):
            layers[index] = fuse_conv_bn_eval(first, second)
            layers[index + 1] = nn.Identity()
