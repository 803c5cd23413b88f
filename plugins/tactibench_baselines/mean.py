"""The training mean: the best answer without looking at the frame."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from tactibench import (
    Answer,
    Contacts,
    FitReport,
    Frame,
    Model,
    ModelContext,
    PlatePose,
    Progress,
    UserError,
)
from tactibench_baselines.labels import pack, read, unpack, write


class MeanModel(Model):
    """A model that answers every frame alike.

    "contacts": one contact at the mean x, y and depth of all contacts of the training frames (no
    contact when they have none). "plate": the mean depth and tilt.
    """

    expected_failed_checks: ClassVar[Mapping[str, str]] = {
        "nan_frame": "answers the training mean and looks at no frame"
    }

    def __init__(self, context: ModelContext) -> None:
        self._answer_kind = context.answer
        self._mean: Answer | None = None

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: tuple[Sequence[Frame], Sequence[Answer]],
        rng: np.random.Generator,
        progress: Progress,
    ) -> FitReport:
        """Average the labels.

        Raises:
            UserError: There is no label.
        """
        del validation, rng, progress
        start = time.perf_counter()
        if not len(truth):
            raise UserError("model 'mean' needs a training label; raise the training count.")
        labels = pack(truth, self._answer_kind)
        if self._answer_kind == "plate":
            self._mean = PlatePose(float(labels["depth"].mean()), float(labels["tilt"].mean()))
        elif not len(labels["depth"]):
            self._mean = Contacts.none()
        else:
            self._mean = Contacts.truth([labels["xy"].mean(axis=0)], [labels["depth"].mean()])
        return FitReport(
            seconds=time.perf_counter() - start, notes={"frames": len(frames)}, prior="none"
        )

    def predict(self, frames: Sequence[Frame]) -> list[Answer]:
        """Return the mean, once for each frame."""
        if self._mean is None:
            raise UserError("model 'mean' has learned nothing yet; train it or load weights first.")
        return [self._mean] * len(frames)

    def stages(self) -> Sequence[tuple[str, Any]]:
        """Return the one phase of ``predict``."""
        return [("forward", self.predict)]

    def save(self, directory: Path) -> None:
        """Write mean.npz."""
        if self._mean is None:
            raise UserError("model 'mean' has learned nothing yet; train it first.")
        write(directory / "mean.npz", pack([self._mean], self._answer_kind))

    def load(self, directory: Path) -> None:
        """Read mean.npz.

        Raises:
            UserError: The file is missing or damaged, or holds labels of another kind.
        """
        (self._mean,) = unpack(read(directory / "mean.npz", self._answer_kind))
