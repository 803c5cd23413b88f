"""The model ``unet``: frames -> heatmaps -> contacts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.nn import functional as F  # noqa: N812

from tactibench import Answer, FitReport, Frame, ModelContext, Progress, UserError
from tactibench.training import (
    RECIPES,
    Examples,
    Seeds,
    autocast,
    count_parameters,
    fold_batch_norm,
    image_tensor,
    load_weights,
    resolve_precision,
    save_weights,
    seeded,
    train,
)
from tactibench_unet.architecture import LEVELS, UNetNetwork
from tactibench_unet.targets import PlateScale, heatmaps, position_error_mm

_BATCH = 32
"""Frames that pass the network at once in ``predict`` and ``maps``."""


class UNet:
    """U-Net of TactiVerse behind the interface of tactibench.

    Raises UserError without an encoder and for a grid that four poolings do not divide.
    """

    def __init__(
        self,
        context: ModelContext,
        recipe: str = "default",
        width: int = 16,
        size: int = 128,
        stem: int = 2,
        epochs: int = 0,
        precision: str = "recipe",
    ) -> None:
        if context.encoder is None:
            raise UserError("model 'unet' learns heatmaps and needs an encoder; name one.")
        if any(cells % 2**LEVELS for cells in context.grid.shape):
            raise UserError(
                f"model 'unet' needs a grid whose sides are multiples of {2**LEVELS} cells, "
                f"not {context.grid.shape}; change the protocol's grid."
            )
        self.recipe = RECIPES[recipe].with_choices(epochs, precision)
        self.size = size
        self._context = context
        self._encoder = context.encoder
        self.architecture: dict[str, Any] = {
            "width": width,
            "size": size,
            "stem": stem,
            "cells": list(context.grid.shape),
            "channels": context.encoder.channels,
            "answer": context.answer,
        }
        self._scale = PlateScale()
        self._use(self._build(seed=0))

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: tuple[Sequence[Frame], Sequence[Answer]],
        rng: np.random.Generator,
        progress: Progress,
    ) -> FitReport:
        """Learn heatmaps by binary cross-entropy. Same rng state, same weights."""
        if not frames:
            raise UserError("model 'unet' was given no training frame; raise the training count.")
        seeds = Seeds.draw(rng)
        self._scale = PlateScale.of(truth, self._context.max_depth)
        training = self._examples(frames, truth)
        held_out = self._examples(*validation)
        wanted = [self._scale.contacts(answer) for answer in validation[1]]
        network = self._build(seeds.init)
        network.start_from(training.images, training.targets)

        def error_mm(logits: torch.Tensor, rows: np.ndarray) -> float | None:
            found = self._encoder.decode_batch(_probabilities(logits), self._context.grid)
            return position_error_mm(found, [wanted[row] for row in rows])

        report = train(
            network,
            training,
            held_out,
            recipe=self.recipe,
            loss=F.binary_cross_entropy_with_logits,
            error_mm=error_mm,
            seeds=seeds,
            identity={"model": "unet", **self.architecture},
            progress=progress,
            device=self._context.device,
            checkpoints=self._context.checkpoints,
        )
        self._use(network)
        return report

    def predict(self, frames: Sequence[Frame]) -> list[Answer | None]:
        """Contacts of every frame, or its plate pose (None where the map shows no contact)."""
        return self.read_maps(self.maps(frames))

    @torch.inference_mode()
    def maps(self, frames: Sequence[Frame]) -> np.ndarray:
        """(N, C, H, W) float32 heatmaps in 0..1, computed in float32."""
        rows, columns = self._context.grid.shape
        out = np.empty((len(frames), self._encoder.channels, rows, columns), dtype=np.float32)
        for start in range(0, len(frames), _BATCH):
            images = image_tensor(frames[start : start + _BATCH], self.size)
            out[start : start + _BATCH] = self._forward(images, "float32")
        return out

    @property
    def timed_as(self) -> str:
        """The configuration of ``stages``."""
        precision = resolve_precision("auto", self._context.device)
        return f"{precision}, batch 1, normalisation folded, channels_last"

    def stages(self) -> list[tuple[str, Callable[[Any], Any]]]:
        """Phases of the fast configuration: bf16 where the device computes it natively."""
        precision = resolve_precision("auto", self._context.device)
        if precision not in self._folded:
            self._folded[precision] = fold_batch_norm(self.network, precision)
        return [
            ("preprocess", lambda frames: image_tensor(frames, self.size)),
            ("forward", lambda images: self._forward(images, precision)),
            ("decode", self.read_maps),
        ]

    def fast_predict(self, frames: Sequence[Frame]) -> list[Answer | None]:
        """The stages one after the other."""
        value: Any = frames
        for _, stage in self.stages():
            value = stage(value)
        return list(value)

    def save(self, directory: Path) -> None:
        """Write the weights into the folder."""
        save_weights(
            directory,
            self.network.state_dict(),
            model="unet",
            architecture=self.architecture,
            extra={"depth_offset_mm": self._scale.offset},
        )

    def load(self, directory: Path) -> None:
        """Read weights. Raises UserError for those of another model or architecture."""
        tensors, extra = load_weights(directory, model="unet", architecture=self.architecture)
        network = self._build(seed=0)
        network.load_state_dict(tensors)
        self._scale = PlateScale(extra["depth_offset_mm"])
        self._use(network)

    @property
    def parameters(self) -> int:
        """Number of trained weights."""
        return count_parameters(self.network)

    def _build(self, seed: int) -> UNetNetwork:
        shape = self.architecture
        rows, columns = shape["cells"]
        with seeded(seed):
            return UNetNetwork(shape["width"], shape["stem"], (rows, columns), shape["channels"])

    def _use(self, network: UNetNetwork) -> None:
        self.network = network.to(self._context.device)
        self._folded = {"float32": fold_batch_norm(self.network)}

    def _examples(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> Examples:
        contacts = [self._scale.contacts(answer) for answer in truth]
        maps = heatmaps(self._encoder, contacts, self._context.grid)
        return Examples(image_tensor(frames, self.size), torch.from_numpy(maps))

    @torch.inference_mode()
    def _forward(self, images: torch.Tensor, precision: str) -> np.ndarray:
        device = self._context.device
        with autocast(precision, device):
            logits = self._folded[precision](images.to(device))
        return _probabilities(logits)

    def read_maps(self, maps: np.ndarray) -> list[Answer | None]:
        """Answers that (N, C, H, W) maps stand for."""
        contacts = self._encoder.decode_batch(maps, self._context.grid)
        if self._context.answer == "plate":
            return [self._scale.plate(found) for found in contacts]
        return list(contacts)


def _probabilities(logits: torch.Tensor) -> np.ndarray:
    heat: np.ndarray = logits.float().sigmoid().cpu().numpy()
    return heat
