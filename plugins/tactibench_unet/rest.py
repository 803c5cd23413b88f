"""The sensor at rest, shown to the network beside the frame: what moved is then seen locally."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import torch

from tactibench import Frame, Pose
from tactibench.training import image_tensor

Image = npt.NDArray[np.uint8]


def rest_image(frames: Sequence[Frame], size: int) -> Image | None:
    """(size, size) rest image of the first frame that has one."""
    rest = next((frame.rest for frame in frames if frame.rest is not None), None)
    return None if rest is None else _sized(rest, size)[0].numpy()


def rest_images(frames: Sequence[Frame], otherwise: Image) -> torch.Tensor:
    """(N, 1, S, S) uint8 rest image of every frame; ``otherwise`` (S, S) where it has none."""
    known = {id(None): torch.from_numpy(otherwise)[None]}
    for frame in frames:  # most share one array
        if frame.rest is not None and id(frame.rest) not in known:
            known[id(frame.rest)] = _sized(frame.rest, len(otherwise))
    images = [known[id(frame.rest)] for frame in frames]
    return torch.stack(images) if images else torch.empty(0, 1, *otherwise.shape, dtype=torch.uint8)


def _sized(rest: Image, size: int) -> torch.Tensor:
    """(1, size, size) uint8 gray."""
    return image_tensor([Frame(rest, 0.0, Pose())], size)[0]
