"""One number for all weights of a network."""

from __future__ import annotations

import hashlib

from torch import nn

from tactibench.training import tensor_bytes


def state_hash(network: nn.Module) -> str:
    """Return the sha256 of the names, types, shapes and bits of all weights and buffers."""
    digest = hashlib.sha256()
    for name, tensor in sorted(network.state_dict().items()):
        digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
        digest.update(tensor_bytes(tensor))
    return digest.hexdigest()
