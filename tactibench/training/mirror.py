"""Mirrored frames: four presses out of one, where the sensor is its own mirror image."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch

ALIKE = 3.0
"""Rms grey levels between a rest frame and its mirror image up to which they are the same."""


def own_mirror(image: npt.NDArray[np.uint8]) -> tuple[bool, bool]:
    """Whether a gray frame (H, W) is its own mirror image with x, and with y, reversed."""
    grey = image.astype(np.float64)
    across, down = (
        bool(np.sqrt(np.square(grey - turned).mean()) < ALIKE)
        for turned in (grey[:, ::-1], grey[::-1])
    )
    return across, down


def random_turns(count: int, allowed: tuple[bool, bool], device: torch.device) -> torch.Tensor:
    """(count, 2) bool: whether x and y of a frame are reversed, at random where they may be."""
    return (torch.rand(count, 2, device=device) < 0.5) & torch.tensor(allowed, device=device)


def mirrored(maps: torch.Tensor, turned: torch.Tensor) -> torch.Tensor:
    """Maps (B, C, H, W) with x and y reversed in the frames that ``turned`` (B, 2) names."""
    maps = torch.where(turned[:, 0, None, None, None], maps.flip(-1), maps)
    return torch.where(turned[:, 1, None, None, None], maps.flip(-2), maps)
