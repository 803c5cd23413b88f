"""The model ``cnn``: frames -> one contact or one plate pose, by regression."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
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
from tactibench_cnn.architecture import CNNNetwork
from tactibench_cnn.targets import NAMES, Normalisation, answers, position_error_mm, vectors

_BATCH = 32
"""Frames that pass the network at once in ``predict``."""
_RECIPES = RECIPES | {"default": replace(RECIPES["default"], epochs=16, learning_rate=2e-3)}
"""A step costs a third of the U-Net's, so the default recipe takes more of them, and smaller."""
_HIDDEN = 128
"""Units of the dense layer."""


class CNN:
    """Regression baseline: exactly one answer for every frame, score 1."""

    def __init__(
        self,
        context: ModelContext,
        recipe: str = "default",
        width: int = 16,
        size: int = 128,
        epochs: int = 0,
        precision: str = "recipe",
    ) -> None:
        self.recipe = _RECIPES[recipe].with_choices(epochs, precision)
        self.size = size
        self._context = context
        self.architecture: dict[str, Any] = {
            "width": width,
            "size": size,
            "hidden": _HIDDEN,
            "answer": context.answer,
        }
        outputs = len(NAMES[context.answer])
        self._normalisation = Normalisation(np.zeros(outputs), np.ones(outputs))
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
        """Regress normalised targets with the Huber loss. Same rng state, same weights.

        Frames without contact have nothing to regress and are left out (counted in the notes).
        Raises UserError for a frame that holds several contacts.
        """
        seeds = Seeds.draw(rng)
        kept, true = self._usable(frames, truth)
        if not kept:
            raise UserError(
                "model 'cnn' was given no training frame with a contact; raise the training count."
            )
        self._normalisation = normalisation = Normalisation.of(true)
        held_out, wanted = self._usable(*validation)
        training = self._examples(kept, true)
        network = self._build(seeds.init)
        network.start_from(training.images)

        def error_mm(outputs: torch.Tensor, rows: np.ndarray) -> float | None:
            found = normalisation.invert(outputs.cpu().numpy())
            return position_error_mm(found, wanted[rows], self._context.answer)

        report = train(
            network,
            training,
            self._examples(held_out, wanted),
            recipe=self.recipe,
            loss=_loss,
            error_mm=error_mm,
            seeds=seeds,
            identity={"model": "cnn", **self.architecture},
            progress=progress,
            device=self._context.device,
            checkpoints=self._context.checkpoints,
        )
        self._use(network)
        left_out = len(frames) - len(kept)
        return replace(report, notes={**report.notes, "without_contact": left_out})

    def predict(self, frames: Sequence[Frame]) -> list[Answer]:
        """One answer per frame, computed in float32."""
        found: list[Answer] = []
        for start in range(0, len(frames), _BATCH):
            images = image_tensor(frames[start : start + _BATCH], self.size)
            found += self._answers(self._forward(images, "float32"))
        return found

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
            ("decode", self._answers),
        ]

    def fast_predict(self, frames: Sequence[Frame]) -> list[Answer]:
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
            model="cnn",
            architecture=self.architecture,
            extra={
                "mean": self._normalisation.mean.tolist(),
                "deviation": self._normalisation.deviation.tolist(),
            },
        )

    def load(self, directory: Path) -> None:
        """Read weights. Raises UserError for those of another model or architecture."""
        tensors, extra = load_weights(directory, model="cnn", architecture=self.architecture)
        network = self._build(seed=0)
        network.load_state_dict(tensors)
        self._normalisation = Normalisation(np.array(extra["mean"]), np.array(extra["deviation"]))
        self._use(network)

    @property
    def parameters(self) -> int:
        """Number of trained weights."""
        return count_parameters(self.network)

    def _build(self, seed: int) -> CNNNetwork:
        shape = self.architecture
        with seeded(seed):
            return CNNNetwork(
                shape["width"], shape["size"], shape["hidden"], len(NAMES[shape["answer"]])
            )

    def _use(self, network: CNNNetwork) -> None:
        self.network = network.to(self._context.device)
        self._folded = {"float32": fold_batch_norm(self.network)}

    def _usable(
        self, frames: Sequence[Frame], truth: Sequence[Answer]
    ) -> tuple[list[Frame], np.ndarray]:
        values = vectors(truth, self._context.answer)
        rows = np.flatnonzero(np.isfinite(values).all(axis=1))
        return [frames[int(row)] for row in rows], values[rows]

    def _examples(self, frames: Sequence[Frame], values: np.ndarray) -> Examples:
        targets = torch.from_numpy(self._normalisation.apply(values))
        return Examples(image_tensor(frames, self.size), targets)

    @torch.inference_mode()
    def _forward(self, images: torch.Tensor, precision: str) -> np.ndarray:
        device = self._context.device
        with autocast(precision, device):
            normal = self._folded[precision](images.to(device))
        out: np.ndarray = normal.float().cpu().numpy()
        return out

    def _answers(self, normal: np.ndarray) -> list[Answer]:
        return answers(self._normalisation.invert(normal), self._context.answer)


def _loss(outputs: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
    """Huber with a knee at a tenth of a deviation: the metric is an absolute error."""
    return F.huber_loss(outputs, targets, delta=0.1) * 10
