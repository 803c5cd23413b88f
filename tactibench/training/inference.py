"""Arithmetic of a network: autocast, deterministic kernels, and a copy for inference."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from itertools import pairwise
from typing import Any

import torch
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

CONFIGURATIONS = {
    "float32": "float32, as trained",
    "folded": "float32, normalisation folded, channels_last",
    "frozen": "float32, normalisation folded, channels_last, frozen graph",
    "bf16": "bf16, normalisation folded, channels_last",
    "bf16-frozen": "bf16, normalisation folded, channels_last, frozen graph",
    "compiled": "float32, normalisation folded, channels_last, torch.compile",
    "onnxruntime": "float32, normalisation folded, ONNX Runtime",
}
"""Name -> description. All compute on the model's device; ONNX Runtime only on a CPU."""


def autocast(precision: str, device: str) -> AbstractContextManager[Any]:
    """Return a context of mixed bf16 arithmetic for "bf16"; for "float32" it changes nothing."""
    if precision == "bf16":
        return torch.autocast(device, dtype=torch.bfloat16)
    return nullcontext()


@contextmanager
def deterministic_kernels(device: str, precision: str) -> Iterator[None]:
    """Let cuDNN choose only kernels that always give the same bits.

    For "float32" it also may not compute in TF32, whose 10 bits it uses for float32 by default.
    """
    if device != "cuda":
        yield
        return
    exact = precision == "float32"
    with torch.backends.cudnn.flags(
        enabled=True, benchmark=False, deterministic=True, allow_tf32=not exact
    ):
        yield


def fold_batch_norm(network: nn.Module, precision: str = "float32") -> nn.Module:
    """Return a copy in evaluation mode in which each Conv2d takes over the BatchNorm2d after it.

    Pairs are found in nn.Sequential containers. In float32 the outputs are those of the network in
    evaluation mode up to rounding. For "bf16" the weights of the convolutions and dense layers are
    stored in bf16. Such a copy must be called under autocast, which then does not cast the weights
    in every call; its outputs are those of the float32 copy under autocast.
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
