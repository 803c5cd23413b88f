"""Every random number of a training comes from the generator that was handed in."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt
import torch


@dataclass(frozen=True)
class Seeds:
    """init: of the network's first weights. order: of the shuffling. layers: of e.g. dropout."""

    init: int
    order: int
    layers: int

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        """Draw all seeds at once, so that the same rng state always gives the same training."""
        return cls(*(int(value) for value in rng.integers(0, 2**62, size=3)))

    def permutation(self, count: int, epoch: int) -> npt.NDArray[np.int64]:
        """(count,) order of the training frames in an epoch; needs no state to be resumed."""
        return np.random.default_rng([self.order, epoch]).permutation(count)

    def of_epoch(self, epoch: int) -> int:
        """Seed of the layers' noise in an epoch; needs no state to be resumed."""
        sequence = np.random.SeedSequence([self.layers, epoch])
        return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(2))


@contextmanager
def seeded(seed: int, device: str = "cpu") -> Iterator[None]:
    """Run torch's own random numbers (layer initialisation, dropout) from a seed.

    The global generators are as they were afterwards.
    """
    cuda = list(range(torch.cuda.device_count())) if device == "cuda" else []
    with torch.random.fork_rng(devices=cuda):
        torch.default_generator.manual_seed(seed)
        if cuda:
            torch.cuda.manual_seed_all(seed)
        yield
