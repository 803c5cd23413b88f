"""Faults of camera and light that a network is trained under, drawn anew for every batch."""

from __future__ import annotations

import math

import torch
from torch.nn import functional as F  # noqa: N812

Images = torch.Tensor

GAIN = (0.35, 2.2)
"""Least and greatest factor on the light of a frame."""
SHIFT_PX, ROTATION_DEG, BLUR_PX, NOISE = 1.2, 3.5, 1.2, 12.0
"""Greatest values for frames of 128 px, noise in grey levels: a little more than what a model has
to bear."""
GLARE_PX, LOST_PINS = 12.0, 4
"""Greatest radius of a reflection, for frames of 128 px, and most pins that lose their tip."""
_OFTEN = 1 / 3
"""Share of the frames that each fault hits: most frames show one or two faults, as in use."""
_PIN_PX = 3.0
"""Radius within which a lost pin is painted over, for frames of 128 px."""
_REFERENCE_PX = 128
"""Side of the frames to which the lengths above belong."""


def disturb(images: Images, share: float) -> Images:
    """Return images (B, C, S, S), grey levels 0..255, with some frames under faults.

    Frames under faults are moved, and each other fault hits one in three of them at a random
    amount. All other frames, and the rest images beside frames, stay as they are.

    Args:
        images: (B, C, S, S) grey levels, for each frame itself, and its rest image where C is 2.
        share: Share of the frames that are under faults: the first ones.
    """
    count = round(share * len(images))
    if not count:
        return images
    frames = images[:count, :1]
    size = frames.shape[-1] / _REFERENCE_PX
    frames = _move(frames, SHIFT_PX * size, ROTATION_DEG)
    for fault in (
        lambda each: _blur(each, BLUR_PX * size),
        lambda each: _lose_pins(each, _PIN_PX * size),
        lambda each: _shine(each, GLARE_PX * size),
        _relight,
        _add_noise,
    ):
        frames = torch.where(_uniform(frames, 0, 1) < _OFTEN, fault(frames), frames)
    under_faults = torch.cat([frames.round().clamp(0, 255), images[:count, 1:]], dim=1)
    return torch.cat([under_faults, images[count:]])


def _uniform(frames: Images, low: float, high: float) -> torch.Tensor:
    """Return one random number a frame, (B, 1, 1, 1)."""
    return low + (high - low) * torch.rand(len(frames), 1, 1, 1, device=frames.device)


def _move(frames: Images, shift_px: float, degrees: float) -> Images:
    """Shift and rotate about the middle, by cubic interpolation; the border is repeated."""
    side = frames.shape[-1]
    turn = _uniform(frames, -1, 1).flatten() * math.radians(degrees)
    way = _uniform(frames, -math.pi, math.pi).flatten()
    length = _uniform(frames, 0, 1).flatten() * shift_px * 2 / (side - 1)
    cos, sin = turn.cos(), turn.sin()
    rows = [cos, -sin, length * way.cos(), sin, cos, length * way.sin()]
    grid = F.affine_grid(
        torch.stack(rows, dim=1).reshape(-1, 2, 3), list(frames.shape), align_corners=True
    )
    return F.grid_sample(frames, grid, mode="bicubic", padding_mode="border", align_corners=True)


def _blur(frames: Images, most_px: float) -> Images:
    """Smooth each frame by a Gaussian of its own width."""
    reach = math.ceil(3 * most_px)
    steps = torch.arange(-reach, reach + 1, device=frames.device, dtype=frames.dtype)
    sigma = _uniform(frames, 0.05, most_px).flatten()
    taps = torch.softmax(-0.5 * (steps / sigma[:, None]).square(), dim=1)
    count = len(frames)
    image = F.pad(frames.transpose(0, 1), (reach,) * 4, mode="replicate")
    image = F.conv2d(image, taps[:, None, :, None], groups=count)
    return F.conv2d(image, taps[:, None, None, :], groups=count).transpose(0, 1)


def _lose_pins(frames: Images, radius: float) -> Images:
    """Paint over bright pixels at a few random places, with the darkest grey around them."""
    ground = -F.max_pool2d(-frames, 2 * math.ceil(radius) + 3, 1, math.ceil(radius) + 1)
    gone = torch.zeros_like(frames)
    for _ in range(LOST_PINS):
        gone = torch.maximum(gone, (_distance(frames, 0.8) < radius).float())
    return torch.lerp(frames, ground, gone)


def _shine(frames: Images, most_px: float) -> Images:
    """Add a round reflection, white in its middle half."""
    radius = _uniform(frames, 1, most_px)
    light = 255 * (2 - 2 * _distance(frames, 0.6) / radius).clamp(0, 1)
    return (frames + light).clamp_max(255)


def _relight(frames: Images) -> Images:
    low, high = (math.log(gain) for gain in GAIN)
    return frames * _uniform(frames, low, high).exp()


def _add_noise(frames: Images) -> Images:
    """Add noise to each frame with its own deviation, which is mostly small."""
    return frames + NOISE * _uniform(frames, 0, 1).square() * torch.randn_like(frames)


def _distance(frames: Images, share: float) -> torch.Tensor:
    """Return the distances (B, 1, S, S), px, from a random place of each frame.

    The place lies in the middle ``share`` of either side.
    """
    side = frames.shape[-1]
    axis = torch.arange(side, device=frames.device, dtype=frames.dtype)
    half = share * (side - 1) / 2
    middle = (side - 1) / 2
    x, y = (middle + _uniform(frames, -half, half) for _ in range(2))
    return torch.hypot(axis[None, None, None, :] - x, axis[None, None, :, None] - y)
