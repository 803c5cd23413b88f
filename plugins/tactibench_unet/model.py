"""The model ``unet``: frames -> heatmaps -> contacts.

The network is the U-Net of TactiVerse: four levels down, a bottleneck, four levels up, skip
connections. It is trained under faults of camera and light, drawn anew for every batch.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import nn
from torch.nn import functional as F  # noqa: N812

from tactibench import (
    Answer,
    Contacts,
    Encoder,
    FitReport,
    Frame,
    Grid,
    ModelContext,
    Pose,
    Progress,
    UserError,
    gray_frames,
)
from tactibench.markers import AlignedImages
from tactibench.training import (
    RECIPES,
    Examples,
    LearnedModel,
    PlateScale,
    draw_flips,
    find_symmetry,
    flip_maps,
    heatmaps,
    image_tensor,
    pack_image,
    relight,
    resting_frames,
    unpack_image,
)

Images = torch.Tensor
Image = npt.NDArray[np.uint8]

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


Labelled = tuple[Sequence[Frame], Sequence[Answer]]

_RECIPES = RECIPES | {
    "default": replace(
        RECIPES["default"], epochs=15, batch=32, optimiser="muon", learning_rate=1.2e-2
    )
}
_MIXED_EPOCHS = 8
"""Epochs with mixed frames. Each then has half as many steps again: the training stays as short."""
_HEADROOM = {"default": 0.7, "paper": 1.0}
"""Share of the sigmoid's range in which heat 0..1 is learned. At 1 the deepest contacts ask for
infinite logits, and a short training leaves them too shallow; the published value is 1."""
_EMPTY = 0.05
"""Empty frames that are added to a training under faults, as a share of its frames."""
_HELD_OUT = 400
"""Most mixed frames that are kept back from the training: as many as protocols validate on."""
_SHARES = np.linspace(0, 0.3, 13)
"""Least scores of a further contact to try, as shares of the highest score."""


class UNet(LearnedModel):
    """U-Net of TactiVerse: from a frame, and the sensor at rest beside it, to heatmaps.

    With the rest image the first convolutions see what moved.

    Raises:
        UserError: There is no encoder, or four poolings do not divide the grid.
    """

    name = "unet"

    def __init__(
        self,
        context: ModelContext,
        recipe: str = "default",
        width: int = 8,
        size: int = 128,
        stem: int = 4,
        epochs: int = 0,
        precision: str = "recipe",
        mixing: float = -1.0,
        neighbours: str = "dome",
        faults: float = 0.0,
    ) -> None:
        if context.encoder is None:
            raise UserError("model 'unet' learns heatmaps and needs an encoder; name one.")
        if any(cells % 2**LEVELS for cells in context.grid.shape):
            raise UserError(
                f"model 'unet' needs a grid whose sides are multiples of {2**LEVELS} cells, "
                f"not {context.grid.shape}; change the protocol's grid."
            )
        architecture: dict[str, Any] = {
            "width": width,
            "size": size,
            "stem": stem,
            "cells": list(context.grid.shape),
            "channels": context.encoder.channels,
            "answer": context.answer,
        }
        if mixing < 0 and context.answer == "plate":  # a plate has no neighbour
            mixing = 0.0
        if mixing and recipe == "default":
            epochs = epochs or _MIXED_EPOCHS
        super().__init__(
            context, _RECIPES[recipe].with_choices(epochs, precision), architecture, mixing
        )
        self._neighbours = neighbours
        self._faults = faults
        self._held_out: Labelled = ([], [])
        self._least = 0.0
        self._encoder = context.encoder
        self._scale = PlateScale()
        self._headroom = _HEADROOM[recipe]
        self._as_published = recipe == "paper"
        self._mirror = (False, False)
        self._aligned: AlignedImages | None = None

    def build(self) -> UNetNetwork:
        shape = self.architecture
        rows, columns = shape["cells"]
        return UNetNetwork(
            shape["width"],
            shape["stem"],
            (rows, columns),
            shape["channels"],
            images=1 if self._aligned is None else 2,
            mirror=self._mirror,
            faults=self._faults,
        )

    def inputs(self, frames: Sequence[Frame]) -> torch.Tensor:
        """Return (N, 1 or 2, S, S) uint8: the frames and, where it is shown, the sensor at rest.

        Frames of another sensor are then seen on the layout of the first training frame's sensor.
        """
        if self._aligned is None:
            return image_tensor(frames, self.architecture["size"])
        return torch.from_numpy(self._aligned(frames))

    def targets(self, truth: Sequence[Answer]) -> torch.Tensor:
        contacts = [self._scale.contacts(answer) for answer in truth]
        return torch.from_numpy(heatmaps(self._encoder, contacts, self.context.grid))

    def loss(self, outputs: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        """Return the binary cross-entropy, as published, of heat within its headroom."""
        return F.binary_cross_entropy_with_logits(outputs, targets * self._headroom)

    def outputs(self, raw: torch.Tensor) -> np.ndarray:
        """Return (N, C, H, W) float32 heat in 0..1."""
        return super().outputs((raw.float().sigmoid() / self._headroom).clamp_max(1.0))

    def answers(self, outputs: np.ndarray) -> list[Answer | None]:
        """Return the contacts of every map, or its plate pose (None without a contact)."""
        decoded = self._encoder.decode_batch(outputs, self.context.grid)
        contacts = [_without_bumps(each, self._least) for each in decoded]
        if self.context.answer == "plate":
            return [self._scale.plate(each) for each in contacts]
        return list(contacts)

    def maps(self, frames: Sequence[Frame]) -> np.ndarray:
        """Return (N, C, H, W) float32 heatmaps in 0..1, computed in float32."""
        return self.evaluate(frames)

    def read_maps(self, maps: np.ndarray) -> list[Answer | None]:
        """Return the answers that (N, C, H, W) maps stand for."""
        return self.answers(maps)

    def empty_frames(self, frames: Sequence[Frame]) -> list[Frame]:
        """Return rest images, which show under faults, too, that nothing touches; else none."""
        return resting_frames(frames, _EMPTY) if self._faults else []

    def prepare(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:
        self._scale = PlateScale.of(truth, self.context.max_depth)
        self._aligned, self._mirror = None, (False, False)
        if self._as_published:
            return
        size = self.architecture["size"]
        self._aligned = AlignedImages.of(frames, size)
        rest = _rest_image(frames, size)
        if rest is not None and _is_symmetric(self._encoder, self.context.grid):
            self._mirror = find_symmetry(rest)

    def initialise(self, network: UNetNetwork, training: Examples) -> None:
        network.initialise(training.images, training.targets * self._headroom)

    def mix(
        self, frames: Sequence[Frame], truth: Sequence[Answer], count: int, rng: np.random.Generator
    ) -> tuple[list[Frame], list[Contacts]]:
        """Return ``count`` mixed frames that are as unlike real ones as the law of neighbours is.

        As many more, at most ``_HELD_OUT``, are kept back to choose what counts as a contact.

        Args:
            frames: Training frames.
            truth: Contacts of the frames.
            count: Number of mixed frames.
            rng: Generator of everything random.

        Returns:
            The mixed frames, and their contacts.

        Raises:
            UserError: The frames do not allow mixing, or the encoder shows single contacts only.
        """
        from tactibench.superposition import MISFIT, NeighbourLaw, mix

        pair = Contacts.truth([[-3.0, 0.0], [3.0, 0.0]], [1.0, 1.0])
        self._encoder.encode(pair, self.context.grid)  # raises where it shows one contact only
        law = NeighbourLaw.none() if self._neighbours == "none" else None
        total = count + min(_HELD_OUT, count)
        mixed, contacts = mix(frames, truth, total, rng, law, misfit=MISFIT)
        self._held_out = mixed[count:], contacts[count:]
        return mixed[:count], contacts[:count]

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: Labelled,
        rng: np.random.Generator,
        progress: Progress,
    ) -> FitReport:
        """Train, then choose how high the score of a further contact must be.

        It is chosen on the validation frames and on mixed frames that were not learned from.
        """
        self._least, self._held_out = 0.0, ([], [])
        report = super().fit(frames, truth, validation=validation, rng=rng, progress=progress)
        mixed, contacts = self._held_out
        if not mixed:
            return report
        predicted = self.predict([*validation[0], *mixed])
        self._least = least_share(predicted, [*validation[1], *contacts])
        return replace(report, notes={**report.notes, "least_share": self._least})

    def extra(self) -> dict[str, Any]:
        return {
            "least_share": self._least,
            "depth_offset_mm": self._scale.offset,
            "headroom": self._headroom,
            "mirror": list(self._mirror),
            "rest": None if self._aligned is None else pack_image(self._aligned.rest),
        }

    def restore(self, extra: dict[str, Any]) -> None:
        self._least = extra["least_share"]
        self._scale = PlateScale(extra["depth_offset_mm"])
        self._headroom = extra["headroom"]
        in_x, in_y = extra["mirror"]
        self._mirror = in_x, in_y
        rest = extra["rest"]
        self._aligned = None if rest is None else AlignedImages(unpack_image(rest))


def least_share(predicted: Sequence[Answer | None], truth: Sequence[Answer]) -> float:
    """Return the share of the highest score below which a contact is best left out.

    With this share the number of contacts is most often right; of several such shares it is the
    least.
    """
    right = [
        sum(
            len(_without_bumps(contacts, share)) == len(true)
            for contacts, true in zip(predicted, truth, strict=True)
            if isinstance(contacts, Contacts) and isinstance(true, Contacts)
        )
        for share in _SHARES
    ]
    return float(_SHARES[int(np.argmax(right))])


def _without_bumps(contacts: Contacts, share: float) -> Contacts:
    """Return the contacts whose score is at least this share of the highest."""
    if len(contacts) < 2 or not share:
        return contacts
    high = contacts.score >= share * contacts.score.max()
    return (
        contacts
        if high.all()
        else Contacts(contacts.xy[high], contacts.depth[high], contacts.score[high])
    )


def _is_symmetric(encoder: Encoder, grid: Grid) -> bool:
    """Return whether a mirrored contact gives mirrored maps, unlike maps that hold steps."""
    x, y = grid.xy(0.6 * grid.shape[0], 0.7 * grid.shape[1])
    middle_x = grid.xy((grid.shape[0] - 1) / 2, (grid.shape[1] - 1) / 2)[0]
    reflected = encoder.encode(Contacts.truth([[2 * middle_x - x, y]], [2.0]), grid)
    maps = encoder.encode(Contacts.truth([[x, y]], [2.0]), grid)
    return bool(np.allclose(reflected[..., ::-1], maps, atol=1e-4))


def _rest_image(frames: Sequence[Frame], size: int) -> Image | None:
    """Return the (size, size) gray rest image of the first frame that has one."""
    rest = next((rest for frame in frames if (rest := frame.rest_image) is not None), None)
    return None if rest is None else gray_frames([Frame(rest, 0.0, Pose())], size)[0]
