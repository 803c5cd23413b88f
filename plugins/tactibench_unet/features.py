"""Activations of every level of the U-Net, for pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import nn

from tactibench_unet.architecture import LEVELS

LAYERS = {
    "stem": "stem",
    **{f"down.{level}": f"down {level + 1}" for level in range(LEVELS)},
    "bottleneck": "bottleneck",
    **{f"up.{level}": f"up {level + 1}" for level in reversed(range(LEVELS))},
}
"""Module -> its name in pictures, in the order of the forward pass."""


@torch.inference_mode()
def layer_features(network: nn.Module, images: torch.Tensor) -> dict[str, npt.NDArray[np.float32]]:
    """Return layer -> (C, H, W) activations of the first image, after normalisation and ReLU."""
    activations: dict[str, npt.NDArray[np.float32]] = {}

    def keep(name: str) -> Any:
        def hook(_module: nn.Module, _inputs: Any, output: torch.Tensor) -> None:
            activations[name] = output[0].float().cpu().numpy()

        return hook

    hooks = [
        network.get_submodule(module).register_forward_hook(keep(name))
        for module, name in LAYERS.items()
    ]
    try:
        network(images[:1])
    finally:
        for hook in hooks:
            hook.remove()
    return activations
