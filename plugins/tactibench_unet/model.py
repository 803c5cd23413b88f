"""The model ``unet``: frames -> heatmaps -> contacts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch.nn import functional as F  # noqa: N812

from tactibench import Answer, Contacts, Encoder, Frame, Grid, ModelContext, UserError
from tactibench.training import (
    RECIPES,
    Examples,
    LearnedModel,
    PlateScale,
    heatmaps,
    image_tensor,
    own_mirror,
    pack_image,
    unpack_image,
)
from tactibench_unet.architecture import LEVELS, UNetNetwork
from tactibench_unet.features import layer_features
from tactibench_unet.rest import rest_image, rest_images

_RECIPES = RECIPES | {
    "default": replace(
        RECIPES["default"], epochs=15, batch=32, optimiser="muon", learning_rate=1.2e-2
    )
}
_HEADROOM = {"default": 0.7, "paper": 1.0}
"""Share of the sigmoid's range that heat 0..1 is learned in. At 1 the deepest contacts ask for
infinite logits, and a short training leaves them too shallow; published is 1."""


class UNet(LearnedModel):
    """U-Net of TactiVerse behind the interface of tactibench.

    Raises UserError without an encoder and for a grid that four poolings do not divide.
    """

    name = "unet"

    def __init__(
        self,
        context: ModelContext,
        recipe: str = "default",
        width: int = 8,
        size: int = 128,
        stem: int = 2,
        epochs: int = 0,
        precision: str = "recipe",
        mixing: float = 0.0,
        mirror: str = "recipe",
        rest: str = "recipe",
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
        super().__init__(
            context, _RECIPES[recipe].with_choices(epochs, precision), architecture, mixing
        )
        self._encoder = context.encoder
        self._scale = PlateScale()
        self._headroom = _HEADROOM[recipe]
        self._may_mirror = mirror == "auto" or (mirror == "recipe" and recipe == "default")
        self._mirror = (False, False)
        self._may_compare = rest == "auto" or (rest == "recipe" and recipe == "default")
        self._rest: npt.NDArray[np.uint8] | None = None

    def build(self) -> UNetNetwork:
        shape = self.architecture
        rows, columns = shape["cells"]
        return UNetNetwork(
            shape["width"],
            shape["stem"],
            (rows, columns),
            shape["channels"],
            seen=1 if self._rest is None else 2,
            mirror=self._mirror,
        )

    def inputs(self, frames: Sequence[Frame]) -> torch.Tensor:
        """(N, 1 or 2, S, S) uint8: the frames and, if the network compares, the sensor at rest."""
        images = image_tensor(frames, self.architecture["size"])
        if self._rest is None:
            return images
        return torch.cat([images, rest_images(frames, self._rest)], dim=1)

    def targets(self, truth: Sequence[Answer]) -> torch.Tensor:
        contacts = [self._scale.contacts(answer) for answer in truth]
        return torch.from_numpy(heatmaps(self._encoder, contacts, self.context.grid))

    def loss(self, outputs: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        """Binary cross-entropy, as published; of heat within its headroom."""
        return F.binary_cross_entropy_with_logits(outputs, targets * self._headroom)

    def outputs(self, raw: torch.Tensor) -> np.ndarray:
        """(N, C, H, W) float32 heat in 0..1."""
        return super().outputs((raw.float().sigmoid() / self._headroom).clamp_max(1.0))

    def answers(self, outputs: np.ndarray) -> list[Answer | None]:
        """Contacts of every map, or its plate pose (None where the map shows no contact)."""
        contacts = self._encoder.decode_batch(outputs, self.context.grid)
        if self.context.answer == "plate":
            return [self._scale.plate(found) for found in contacts]
        return list(contacts)

    def maps(self, frames: Sequence[Frame]) -> np.ndarray:
        """(N, C, H, W) float32 heatmaps in 0..1, computed in float32."""
        return self.evaluate(frames)

    def read_maps(self, maps: np.ndarray) -> list[Answer | None]:
        """Answers that (N, C, H, W) maps stand for."""
        return self.answers(maps)

    def features(self, frame: Frame) -> dict[str, np.ndarray]:
        """Layer -> (C, H, W) activations, see ``features``."""
        return layer_features(self.network, self.inputs([frame]).to(self.context.device))

    def prepare(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:
        self._scale = PlateScale.of(truth, self.context.max_depth)
        rest = rest_image(frames, self.architecture["size"])
        every = all(frame.rest is not None for frame in frames)
        self._rest = rest if self._may_compare and every else None
        self._mirror = (False, False)
        if self._may_mirror and rest is not None and _mirrors(self._encoder, self.context.grid):
            self._mirror = own_mirror(rest)

    def start(self, network: UNetNetwork, training: Examples) -> None:
        network.start_from(training.images, training.targets * self._headroom)

    def extra(self) -> dict[str, Any]:
        return {
            "depth_offset_mm": self._scale.offset,
            "headroom": self._headroom,
            "rest": None if self._rest is None else pack_image(self._rest),
        }

    def use_extra(self, extra: dict[str, Any]) -> None:
        self._scale = PlateScale(extra["depth_offset_mm"])
        self._headroom = extra["headroom"]
        self._rest = None if extra["rest"] is None else unpack_image(extra["rest"])


def _mirrors(encoder: Encoder, grid: Grid) -> bool:
    """Whether a mirrored contact gives the mirrored maps; not where maps hold steps."""
    x, y = grid.xy(0.6 * grid.shape[0], 0.7 * grid.shape[1])
    middle = grid.xy((grid.shape[0] - 1) / 2, (grid.shape[1] - 1) / 2)
    across = encoder.encode(Contacts.truth([[2 * middle[0] - x, y]], [2.0]), grid)
    own = encoder.encode(Contacts.truth([[x, y]], [2.0]), grid)
    return bool(np.allclose(across[..., ::-1], own, atol=1e-4))
