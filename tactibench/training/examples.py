"""Labelled frames as tensors, prepared once before the first epoch and mirrored in training."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch

from tactibench.contacts import Frame, Pose
from tactibench.images import gray_frames
from tactibench.training.weights import tensor_bytes

_SAME_RMS = 3.0
"""Rms difference of a rest frame and its mirror image, grey levels, below which they are equal."""


@dataclass(frozen=True, eq=False)
class Examples:
    """Frames and targets of a training.

    Attributes:
        images: (N, ...) uint8 images or float features, as the network takes them.
        targets: (N, ...) float16 or float32, used as float32.

    Raises:
        ValueError: The numbers of images and targets differ.
    """

    images: torch.Tensor
    targets: torch.Tensor

    def __post_init__(self) -> None:
        if len(self.images) != len(self.targets):
            raise ValueError(f"{len(self.images)} images have {len(self.targets)} targets")

    def __len__(self) -> int:
        return len(self.images)

    def take(self, rows: torch.Tensor, device: str) -> tuple[torch.Tensor, torch.Tensor]:
        """Return images (B, ...) and targets (B, ...) float32 of one batch on the device."""
        rows = rows.to(self.images.device)
        return self.images[rows].to(device), self.targets[rows].to(device).float()

    def spread_rows(self, count: int) -> torch.Tensor:
        """Return at most ``count`` rows whose means are about those of all rows.

        They are spread evenly over the frames in the order of their mean target.
        """
        order = self.targets.float().flatten(1).mean(dim=1).argsort(stable=True).cpu()
        ranks = np.linspace(0, len(order) - 1, min(count, len(order))).round().astype(np.int64)
        return order[torch.from_numpy(ranks)]

    def to(self, device: str) -> Examples:
        """Return the same examples in the memory of a device, to save a copy in every step."""
        return Examples(self.images.to(device), self.targets.to(device))

    def bits(self) -> bytes:
        """Return all data that the weights can depend on, for an identity."""
        shapes = f"{tuple(self.images.shape)} {tuple(self.targets.shape)} {self.targets.dtype}"
        return shapes.encode() + tensor_bytes(self.images) + tensor_bytes(self.targets)


def resting_frames(frames: Sequence[Frame], share: float) -> list[Frame]:
    """Return rest images of frames, as frames without contact.

    Args:
        frames: Frames of a training.
        share: Number of rest images as a share of the frames that have one.
    """
    rests = [(frame.rest, frame.timestamp) for frame in frames if frame.rest is not None]
    return [Frame(rest, when, Pose(), rest) for rest, when in rests[:: round(1 / share)]]


def image_tensor(frames: Sequence[Frame], size: int) -> torch.Tensor:
    """Return (N, 1, size, size) uint8 gray images of frames of any size and colour."""
    return torch.from_numpy(gray_frames(frames, size)[:, np.newaxis])


def relight(images: torch.Tensor) -> torch.Tensor:
    """Return images, scaled to the mean light of their rest frames, (B, 2, S, S).

    Contacts move bright pins and change the mean of a frame by less than 1 %.

    Args:
        images: (B, 2, S, S) float, each frame with its rest frame.
    """
    frame, rest = images[:, :1], images[:, 1:]
    light = rest.mean(dim=(2, 3), keepdim=True) / frame.mean(dim=(2, 3), keepdim=True).clamp_min(1)
    return torch.cat([frame * light, rest], dim=1)


def find_symmetry(image: npt.NDArray[np.uint8]) -> tuple[bool, bool]:
    """Return whether a gray frame (H, W) stays the same with x reversed, and with y reversed."""
    grey = image.astype(np.float64)
    in_x, in_y = (
        bool(np.sqrt(np.square(grey - flipped).mean()) < _SAME_RMS)
        for flipped in (grey[:, ::-1], grey[::-1])
    )
    return in_x, in_y


def draw_flips(count: int, symmetry: tuple[bool, bool], device: torch.device) -> torch.Tensor:
    """Return whether to reverse x and y of each frame, at random where allowed, (count, 2) bool.

    Args:
        count: Number of frames.
        symmetry: Whether x, and whether y, may be reversed.
        device: Device of the result.
    """
    return (torch.rand(count, 2, device=device) < 0.5) & torch.tensor(symmetry, device=device)


def flip_maps(maps: torch.Tensor, flips: torch.Tensor) -> torch.Tensor:
    """Return maps (B, C, H, W) with x and y reversed where ``flips`` (B, 2) is True."""
    maps = torch.where(flips[:, 0, None, None, None], maps.flip(-1), maps)
    return torch.where(flips[:, 1, None, None, None], maps.flip(-2), maps)
