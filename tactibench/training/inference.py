"""Arithmetic of a network: its numbers, deterministic kernels, a copy for inference, ONNX."""

from __future__ import annotations

import copy
import io
import warnings
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from itertools import pairwise
from typing import Any

import torch
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval


def autocast(precision: str, device: str) -> AbstractContextManager[Any]:
    """Return a context of mixed bf16 arithmetic for "bf16"; for "float32" it changes nothing."""
    if precision == "bf16":
        return torch.autocast(device, dtype=torch.bfloat16)
    return nullcontext()


@contextmanager
def float32_tensors() -> Iterator[None]:
    """Make new tensors float32 inside the block, whatever the caller's default type is."""
    before = torch.get_default_dtype()
    torch.set_default_dtype(torch.float32)
    try:
        yield
    finally:
        torch.set_default_dtype(before)


@contextmanager
def deterministic_kernels(device: str, precision: str = "float32") -> Iterator[None]:
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


def fold_batch_norm(network: nn.Module) -> nn.Module:
    """Return a copy in evaluation mode in which each Conv2d takes over the BatchNorm2d after it.

    Pairs are found in nn.Sequential containers. The outputs are those of the network in evaluation
    mode up to rounding.
    """
    folded = copy.deepcopy(network).eval()
    for module in folded.modules():
        if isinstance(module, nn.Sequential):
            _fold_pairs(module)
    return folded.to(memory_format=torch.channels_last)  # type: ignore[call-overload, no-any-return]


def _fold_pairs(layers: nn.Sequential) -> None:
    for index, (first, second) in enumerate(pairwise(list(layers))):
        if isinstance(first, nn.Conv2d) and isinstance(second, nn.BatchNorm2d):
            layers[index] = fuse_conv_bn_eval(first, second)
            layers[index + 1] = nn.Identity()


def onnx_model(network: nn.Module, example: torch.Tensor) -> bytes:
    """Return a network as an ONNX model with a free number of frames.

    Args:
        network: A network in evaluation mode, on the CPU, from "inputs" to "outputs".
        example: (N, ...) inputs.
    """
    plain = copy.deepcopy(network)
    for tensor in (*plain.parameters(), *plain.buffers()):
        tensor.data = tensor.data.contiguous()
    file = io.BytesIO()
    export: Any = torch.onnx.export  # its type does not know that it writes to memory, too
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")  # of the tracer; the caller compares the outputs
        export(
            plain,
            (example,),
            file,
            dynamo=False,
            input_names=["inputs"],
            output_names=["outputs"],
            dynamic_axes={"inputs": {0: "frames"}, "outputs": {0: "frames"}},
        )
    return file.getvalue()
