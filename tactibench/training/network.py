"""Facts about a network."""

from __future__ import annotations

import hashlib

import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode


def count_parameters(network: nn.Module) -> int:
    """Number of trained weights."""
    return sum(weight.numel() for weight in network.parameters())


def count_flops(network: nn.Module, inputs: torch.Tensor) -> int:
    """Floating-point operations of a forward pass, a product and a sum counted as two.

    Convolutions and matrix products are counted; sums, activations and poolings are not.
    """
    counter = FlopCounterMode(display=False)
    with torch.no_grad(), counter:
        network(inputs)
    return int(counter.get_total_flops())


def state_hash(network: nn.Module) -> str:
    """sha256 over the names, types, shapes and bits of all weights and buffers."""
    digest = hashlib.sha256()
    for name, tensor in sorted(network.state_dict().items()):
        digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
        digest.update(tensor_bytes(tensor))
    return digest.hexdigest()


def tensor_bytes(tensor: torch.Tensor) -> bytes:
    """The bits of a tensor in row-major order."""
    flat = tensor.detach().cpu().contiguous().reshape(-1)
    return flat.view(torch.uint8).numpy().tobytes()
