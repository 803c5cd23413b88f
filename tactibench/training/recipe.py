"""Training recipes: the schedule of a training, and the seeds of its random numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np
import numpy.typing as npt
import torch


@dataclass(frozen=True)
class Recipe:
    """A training schedule.

    Attributes:
        epochs: Passes over the training frames.
        batch: Frames of a step.
        optimiser: "adam", "adamw" or "muon" (see ``Muon``).
        learning_rate: The constant rate, or the peak of the one-cycle schedule.
        schedule: "constant" or "one-cycle".
        warmup: Share of all steps in which the rate of one-cycle rises.
        weight_decay: Weight decay of kernels.
        patience: Epochs without a better validation loss after which the training stops and the
            best weights are taken; None to run all epochs and take the last weights.
        precision: Precision of the training arithmetic, "float32" or "bf16".
        channels_last: Whether tensors of convolutions have this memory layout.
        average: Decay per step of the mean of the weights, which is taken (see
            ``average_weights``); 0 to take the last weights.
    """

    epochs: int
    batch: int
    optimiser: Literal["adam", "adamw", "muon"] = "adamw"
    learning_rate: float = 1e-3
    schedule: Literal["constant", "one-cycle"] = "one-cycle"
    warmup: float = 0.3
    weight_decay: float = 0.0
    patience: int | None = None
    precision: str = "float32"
    channels_last: bool = True
    average: float = 0.0

    def rate(self, step: int, steps: int) -> float:
        """Return the learning rate of an optimiser step, counted from 0, of ``steps`` steps.

        One-cycle is half a cosine from peak / 25 up to the peak, then half a cosine down to
        peak / 1e4 (Smith and Topin 2018, with cosines as in fastai).
        """
        if self.schedule == "constant":
            return self.learning_rate
        peak, start, end = self.learning_rate, self.learning_rate / 25, self.learning_rate / 1e4
        top = max(1.0, self.warmup * steps)
        if step < top:
            return _cosine(start, peak, step / top)
        return _cosine(peak, end, (step - top) / max(1.0, steps - 1 - top))

    def with_choices(self, epochs: int = 0, precision: str = "recipe") -> Recipe:
        """Return this recipe with the user's values.

        Args:
            epochs: Number of epochs; 0 for those of the recipe.
            precision: Precision of the training; "recipe" for that of the recipe.
        """
        return replace(
            self,
            epochs=epochs or self.epochs,
            precision=self.precision if precision == "recipe" else precision,
        )


def _cosine(first: float, last: float, share: float) -> float:
    return last + (first - last) * (1 + math.cos(math.pi * min(1.0, share))) / 2


RECIPES = {
    "paper": Recipe(
        epochs=50,
        batch=8,
        optimiser="adam",
        learning_rate=3e-4,
        schedule="constant",
        patience=10,
        channels_last=False,
    ),
    "default": Recipe(
        epochs=12, batch=16, learning_rate=4e-3, warmup=0.2, weight_decay=1e-2, average=0.998
    ),
}
"""paper: TactiVerse, table of hyperparameters (which does not give the patience).

default: with it the U-Net reaches 0.06 mm several times sooner than with ``paper`` and ends at half
the error (benchmarks/time_to_accuracy.py, leaderboards/exp1.md)."""


@dataclass(frozen=True)
class Seeds:
    """Seeds of a training.

    Attributes:
        init: Seed of the network's first weights.
        order: Seed of the shuffling.
        layers: Seed of noise in layers (dropout).
    """

    init: int
    order: int
    layers: int

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        """Draw all seeds at once, so that the same rng state always gives the same training."""
        return cls(*(int(value) for value in rng.integers(0, 2**62, size=3)))

    def permutation(self, count: int, epoch: int) -> npt.NDArray[np.int64]:
        """Return the order of the training frames in an epoch, (count,), without stored state."""
        return np.random.default_rng([self.order, epoch]).permutation(count)

    def of_epoch(self, epoch: int) -> int:
        """Return the seed of the layers' noise in an epoch, without stored state."""
        sequence = np.random.SeedSequence([self.layers, epoch])
        return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(2))


@contextmanager
def torch_seed(seed: int, device: str = "cpu") -> Iterator[None]:
    """Draw torch's random numbers (layer initialisation, dropout) from a seed inside the block.

    Afterwards the global generators are as before.
    """
    cuda = list(range(torch.cuda.device_count())) if device == "cuda" else []
    with torch.random.fork_rng(devices=cuda):
        torch.default_generator.manual_seed(seed)
        if cuda:
            torch.cuda.manual_seed_all(seed)
        yield
