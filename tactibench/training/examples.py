"""Labelled frames as tensors, prepared once before the first epoch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from tactibench.contacts import Frame, Pose
from tactibench.images import gray_frames
from tactibench.training.network import tensor_bytes


@dataclass(frozen=True, eq=False)
class Examples:
    """images: (N, ...) uint8 images or float features, as the network takes them.

    targets: (N, ...) float16 or float32, used as float32.
    """

    images: torch.Tensor
    targets: torch.Tensor

    def __post_init__(self) -> None:
        if len(self.images) != len(self.targets):
            raise ValueError(f"{len(self.images)} images have {len(self.targets)} targets")

    def __len__(self) -> int:
        return len(self.images)

    def take(self, index: torch.Tensor, device: str) -> tuple[torch.Tensor, torch.Tensor]:
        """Images (B, ...) and targets (B, ...) float32 of one batch on the device."""
        at = index.to(self.images.device)
        return self.images[at].to(device), self.targets[at].to(device).float()

    def spread(self, count: int) -> torch.Tensor:
        """At most ``count`` rows with the same means as all have: evenly spread over the frames
        when these are ordered by their mean target."""
        order = self.targets.float().flatten(1).mean(dim=1).argsort(stable=True).cpu()
        at = np.linspace(0, len(order) - 1, min(count, len(order))).round().astype(np.int64)
        return order[torch.from_numpy(at)]

    def to(self, device: str) -> Examples:
        """The same examples in the memory of a device: no copy in every step."""
        return Examples(self.images.to(device), self.targets.to(device))

    def bits(self) -> bytes:
        """Everything the weights can depend on, for an identity."""
        shapes = f"{tuple(self.images.shape)} {tuple(self.targets.shape)} {self.targets.dtype}"
        return shapes.encode() + tensor_bytes(self.images) + tensor_bytes(self.targets)


def resting_frames(frames: Sequence[Frame], share: float) -> list[Frame]:
    """The rest images that the frames bring with them, as frames without contact: ``share`` of as
    many as there are frames with one."""
    rests = [(frame.rest, frame.timestamp) for frame in frames if frame.rest is not None]
    return [Frame(rest, when, Pose(), rest) for rest, when in rests[:: round(1 / share)]]


def image_tensor(frames: Sequence[Frame], size: int) -> torch.Tensor:
    """(N, 1, size, size) uint8 gray images of frames of any size and colour."""
    return torch.from_numpy(gray_frames(frames, size)[:, np.newaxis])
