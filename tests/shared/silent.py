"""Progress displays that nobody sees and that remember what they were told."""

from __future__ import annotations

from tactibench.run import NullProgress


class Epochs(NullProgress):
    """epochs: (number, loss, validation error in mm) of each."""

    def __init__(self) -> None:
        self.epochs: list[tuple[int, float, float | None]] = []

    def epoch(self, epoch: int, loss: float, validation_mm: float | None) -> None:
        self.epochs.append((epoch, loss, validation_mm))
