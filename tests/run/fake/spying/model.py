"""The plugin's model: it answers the middle, and looks for the truth in `fit` and in `predict`."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tactibench import Contacts, FitReport, Frame, Model, ModelContext

from . import attacks, report


class Spy(Model):
    """Answers the middle of the sensor."""

    def __init__(self, _context: ModelContext) -> None:
        self.asked = 0

    def fit(self, _frames: Any, _truth: Any, **_: Any) -> FitReport:
        return FitReport()

    def predict(self, frames: Sequence[Frame]) -> list[Contacts]:
        self.asked += 1
        for name, attack in attacks.ATTACKS.items() if self.asked in (1, 5) else ():
            with contextlib.suppress(OSError):
                report.note(name, attack(frames[0]))
        return [Contacts(np.zeros((1, 2)), np.ones(1), np.ones(1)) for _ in frames]

    def save(self, directory: Path) -> None:
        (directory / "weights").write_text("none")

    def load(self, directory: Path) -> None:
        assert (directory / "weights").read_text() == "none"
