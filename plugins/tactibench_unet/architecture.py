"""The U-Net of TactiVerse: four levels down, a bottleneck, four levels up, skip connections.

Faults of camera and light that a network is trained under, drawn anew for every batch.
"""

from __future__ import annotations

import math

import torch
from torch import nn
from torch.nn import functional as F  # noqa: N812

from tactibench.training import draw_flips, flip_maps, relight

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


LEVELS = 4


class UNetNetwork(nn.Module):
    """(B, images, S, S) uint8 frames -> (B, channels, H, W) logits of the heatmap.

    A stem brings the frame to the heatmap's cells: a convolution of the given stride, then
    pooling or resizing for what is left. Level k has ``width * 2**k`` channels. Weights are those
    of Ronneberger et al. 2015 with batch normalisation and padded convolutions; the sigmoid of
    the last layer belongs to the loss (training) and to ``predict``.

    With stride 4 a second convolution takes the place of the first level, the most expensive one:
    the levels start at every second cell, and the head gives the four cells of each (Shi et al.
    2016, sub-pixel convolution).
    """

    mean: torch.Tensor
    scale: torch.Tensor

    def __init__(
        self,
        width: int,
        stem: int,
        cells: tuple[int, int],
        channels: int,
        *,
        images: int = 1,
        mirror: tuple[bool, bool] = (False, False),
        faults: float = 0.0,
    ) -> None:
        """Build the layers.

        Args:
            width: Channels of the first level.
            stem: Stride of the stem, 1, 2 or 4.
            cells: Rows and columns of the heatmap.
            channels: Maps of the encoder.
            images: Images of a frame: 1, itself; 2, itself and the sensor at rest.
            mirror: Whether x, and y, of frames may be reversed. In training each is reversed at
                random; afterwards the logits are means over the frame and the frame with all of
                these axes reversed.
            faults: Share of the training frames that are shown under faults of camera and light.
        """
        super().__init__()
        self.mirror = mirror
        self.faults = faults
        self.step = 2 if stem == 4 else 1
        """Cells along each side that one place of the first level gives."""
        self.cells = cells[0] // self.step, cells[1] // self.step
        first = self.step - 1
        widths = [width * 2**level for level in range(first, LEVELS + 1)]
        levels = len(widths) - 1
        self.register_buffer("mean", torch.zeros(()))
        self.register_buffer("scale", torch.ones(()))
        self.stem = _convolution(images, width, stride=min(stem, 2))
        if stem == 4:
            self.stem.extend(_convolution(width, widths[0], stride=2))
        self.down = nn.ModuleList(
            _block(widths[max(level - 1, 0)], widths[level]) for level in range(levels)
        )
        self.bottleneck = _block(widths[levels - 1], widths[levels])
        self.lift = nn.ModuleList(
            nn.ConvTranspose2d(widths[level + 1], widths[level], 2, stride=2)
            for level in range(levels)
        )
        self.up = nn.ModuleList(_block(2 * widths[level], widths[level]) for level in range(levels))
        self.head = nn.Conv2d(widths[0], channels * self.step**2, 1)

    @torch.no_grad()
    def initialise(self, images: torch.Tensor, targets: torch.Tensor) -> None:
        """Fix the input scale to the training frames and the output to their mean heat.

        The head starts at the logit of the mean target, so that the first steps are not spent on
        learning that most of a map is empty.

        Args:
            images: (N, images, S, S) uint8 frames.
            targets: (N, channels, H, W) heat, 0..1.
        """
        values = images.float()
        self.mean.copy_(values.mean())
        self.scale.copy_(1 / values.std(correction=0).clamp_min(1.0))
        heat = targets.float().mean(dim=(0, 2, 3)).clamp(1e-3, 1 - 1e-3)
        if self.head.bias is not None:
            self.head.bias.copy_(torch.logit(heat).repeat_interleave(self.step**2))

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        images = images.float()
        # Statistics of batch normalisation are measured over frames like those of the training.
        if self.faults and self.stem[1].training:
            images = disturb(images, self.faults)
        if images.shape[1] > 1:
            images = relight(images)
        if not any(self.mirror):
            return self._logits(images)
        if self.training:
            flips = draw_flips(len(images), self.mirror, images.device)
            return flip_maps(self._logits(flip_maps(images, flips)), flips)
        axes = [axis for axis, mirrored in zip((-1, -2), self.mirror, strict=True) if mirrored]
        seen, mirrored = self._logits(torch.cat([images, images.flip(axes)])).chunk(2)
        return (seen + mirrored.flip(axes)) / 2

    def _logits(self, images: torch.Tensor) -> torch.Tensor:
        x = self.stem((images - self.mean) * self.scale)
        x = _to_cells(x, self.cells)
        skips = []
        for block in self.down:
            x = block(x)
            skips.append(x)
            x = F.max_pool2d(x, 2)
        x = self.bottleneck(x)
        for lift, block, skip in zip(
            reversed(self.lift), reversed(self.up), reversed(skips), strict=True
        ):
            x = block(torch.cat([skip, lift(x)], dim=1))
        logits: torch.Tensor = self.head(x)
        return F.pixel_shuffle(logits, self.step) if self.step > 1 else logits


def _to_cells(x: torch.Tensor, cells: tuple[int, int]) -> torch.Tensor:
    rows, columns = x.shape[-2:]
    if (rows, columns) == cells:
        return x
    if (rows, columns) == (2 * cells[0], 2 * cells[1]):
        return F.max_pool2d(x, 2)
    return F.interpolate(x, size=cells, mode="bilinear", align_corners=False)


def _convolution(channels: int, width: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(channels, width, 3, stride=stride, padding=1, bias=False),
        nn.BatchNorm2d(width),
        nn.ReLU(inplace=True),
    )


def _block(channels: int, width: int) -> nn.Sequential:
    return nn.Sequential(*_convolution(channels, width), *_convolution(width, width))
