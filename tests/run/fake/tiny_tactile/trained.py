"""A tiny model that learns with the training loop of the shipped ones: checkpoints and weights."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from tactibench import Contacts, FitReport, Frame, Model, ModelContext
from tactibench.training import (
    Examples,
    Recipe,
    Seeds,
    load_weights,
    save_weights,
    torch_seed,
    train,
)
from tiny_tactile.parts import SCALE


class TrainedModel(Model):
    """Depth of the first tip is a learned linear function of its pixel."""

    def __init__(self, context: ModelContext, epochs: int = 6) -> None:
        self.context, self.epochs = context, epochs
        self.network: nn.Module = nn.Linear(1, 1)

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Contacts],
        *,
        validation: tuple[Sequence[Frame], Sequence[Contacts]],
        rng: np.random.Generator,
        progress: Any,
    ) -> FitReport:
        seeds = Seeds.draw(rng)
        with torch_seed(seeds.init):
            self.network = nn.Linear(1, 1)
        return train(
            self.network,
            _examples(frames, truth),
            _examples(*validation),
            recipe=Recipe(self.epochs, 8, precision="float32", channels_last=False),
            loss=nn.functional.mse_loss,
            error_mm=lambda *_: None,
            seeds=seeds,
            identity={"model": "tiny-trained"},
            progress=progress,
            checkpoints=self.context.checkpoints,
        )

    def predict(self, frames: Sequence[Frame]) -> list[Contacts]:
        answers = []
        for frame in frames:
            count = int(frame.image[0, 3])
            values = (frame.image[:count, :3].astype(np.float64) - 128) / SCALE
            with torch.no_grad():
                depth = self.network(torch.tensor(values[:, 2:], dtype=torch.float32)).numpy()
            answers.append(Contacts(values[:, :2], depth[:, 0].astype(float), np.ones(count)))
        return answers

    def save(self, directory: Path) -> None:
        tensors = self.network.state_dict()
        save_weights(directory, tensors, model="tiny-trained", architecture={})

    def load(self, directory: Path) -> None:
        tensors, _ = load_weights(directory, model="tiny-trained", architecture={})
        self.network.load_state_dict(tensors)


def _examples(frames: Sequence[Frame], truth: Sequence[Contacts]) -> Examples:
    pixels = np.array([[(frame.image[0, 2] - 128.0) / SCALE] for frame in frames])
    depths = np.array([[contacts.depth[0]] for contacts in truth])
    return Examples(torch.tensor(pixels).float(), torch.tensor(depths).float())
