"""The U-Net of TactiVerse: four levels down, a bottleneck, four levels up, skip connections."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import nn
from torch.nn import functional as F  # noqa: N812

from tactibench.training import draw_flips, flip_maps, relight
from tactibench_unet.nuisances import disturb

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

    @property
    def layers(self) -> dict[str, str]:
        """Return module -> its name in pictures, in the order of the forward pass."""
        levels = range(len(self.down))
        return {
            "stem": "stem",
            **{f"down.{level}": f"down {level + 1}" for level in levels},
            "bottleneck": "bottleneck",
            **{f"up.{level}": f"up {level + 1}" for level in reversed(levels)},
        }

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


@torch.inference_mode()
def layer_features(
    network: UNetNetwork, images: torch.Tensor
) -> dict[str, npt.NDArray[np.float32]]:
    """Return layer -> (C, H, W) activations of the first image, after normalisation and ReLU."""
    activations: dict[str, npt.NDArray[np.float32]] = {}

    def keep(name: str) -> Any:
        def hook(_module: nn.Module, _inputs: Any, output: torch.Tensor) -> None:
            activations[name] = output[0].float().cpu().numpy()

        return hook

    hooks = [
        network.get_submodule(module).register_forward_hook(keep(name))
        for module, name in network.layers.items()
    ]
    try:
        network(images[:1])
    finally:
        for hook in hooks:
            hook.remove()
    return activations
