"""A model whose contacts are refined by fields of single presses (parameter ``refine``)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tactibench.contacts import Answer, Frame
from tactibench.errors import UserError
from tactibench.markers import AlignedSensors, PinTracker
from tactibench.plugins import FitReport, Model, Progress, Stage
from tactibench.superposition import FieldFamily, Refinement, Spread
from tactibench.training.weights import load_weights, save_weights

FOLDER = "refinement"
"""Folder of the fields, beside the weights of the model."""


class RefinedModel(Model):
    """A model and the refinement of its contacts; without fields it is the model alone.

    Its maps are not shown, because its answers do not stand in them alone.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self._refinement: Refinement | None = None

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: tuple[Sequence[Frame], Sequence[Answer]],
        rng: np.random.Generator,
        progress: Progress,
    ) -> FitReport:
        """Train the model, and learn the fields from the single presses among the frames."""
        report = self.model.fit(frames, truth, validation=validation, rng=rng, progress=progress)
        return self.learn_fields(report, frames, truth, validation)

    def learn_fields(
        self,
        report: FitReport,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        validation: tuple[Sequence[Frame], Sequence[Answer]],
    ) -> FitReport:
        """Learn the fields beside a model that is trained; its report is told with theirs."""
        try:
            self._refinement = Refinement.learn(frames, truth, validation)
        except UserError as error:
            return replace(report, notes={**report.notes, "not_refined": str(error)})
        return report

    def predict(self, frames: Sequence[Frame]) -> Sequence[Answer | None]:
        """Return one answer a frame: the stages in turn."""
        value: Any = frames
        for _, stage in self.stages():
            value = stage(value)
        answers: Sequence[Answer | None] = value
        return answers

    def stages(self) -> Sequence[Stage]:
        """Return the phases of the model, and ``refine``."""
        stages, refinement = self.model.stages(), self._refinement
        if refinement is None:
            return stages
        (name, first), *others = stages
        return [
            (name, lambda frames: (frames, first(frames))),
            *((name, _beside_frames(stage)) for name, stage in others),
            ("refine", lambda pair: refinement(*pair)),
        ]

    def adapt(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> Mapping[str, Any] | None:
        """Adapt the model, and the fields, to labelled presses of the tested sensor."""
        chosen = self.model.adapt(frames, truth)
        if self._refinement is not None:
            self._refinement.show(frames, truth)
        return chosen

    def save(self, directory: Path) -> None:
        """Write the weights of the model, and the fields beside them."""
        self.model.save(directory)
        if (refinement := self._refinement) is None:
            return
        (directory / FOLDER).mkdir()
        arrays = {
            **refinement.family.arrays(),
            "weight": refinement.weight,
            "spread": refinement.spread.terms,
            "still": refinement.seen.first.rest_image,
        }
        save_weights(directory / FOLDER, arrays, model=FOLDER, architecture={})

    def load(self, directory: Path) -> None:
        """Read what ``save`` wrote."""
        self.model.load(directory)
        self._refinement = None
        if not (directory / FOLDER).is_dir():
            return
        tensors, _ = load_weights(directory / FOLDER, model=FOLDER, architecture={})
        arrays = {name: value.numpy() for name, value in tensors.items()}
        family = FieldFamily.of(arrays, len(arrays["weight"]))
        seen = AlignedSensors(PinTracker(arrays["still"]))
        spread = Spread(arrays["spread"])
        self._refinement = Refinement(seen, family, arrays["weight"], spread)

    def parameter_count(self) -> int | None:
        """Return the number of trained weights, those of the fields included."""
        count = self.model.parameter_count()
        if count is None or self._refinement is None:
            return count
        return count + int(self._refinement.family.field.coefficients.size)

    def flops(self, frame: Frame) -> int | None:
        """Return the operations of the model's forward pass; the fit is not counted."""
        return self.model.flops(frame)


def _beside_frames(stage: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda pair: (pair[0], stage(pair[1]))
