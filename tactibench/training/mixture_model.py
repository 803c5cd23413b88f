"""The base class of models with a mixture of Gaussians, and the calibration of their std."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from tactibench.contacts import Answer, Contacts, Frame
from tactibench.errors import UserError
from tactibench.markers import AlignedSensors, Tracks
from tactibench.plugins import FitReport, ModelContext, Progress
from tactibench.training.learned import LearnedModel
from tactibench.training.mixture import MixtureScale, mixture_loss, mixture_values, pack_contacts
from tactibench.training.recipe import Recipe
from tactibench.training.targets import PlateScale

Array = npt.NDArray[Any]
Rows = npt.NDArray[np.int64]

_AS_STATED = np.ones((2, 3))
_CALIBRATION_STEP = 20
"""One frame in this many with several contacts is not learned from, to calibrate the std."""
_FEWEST = 20
"""Fewest contacts from which a 95 % quantile is read; with fewer the stated std is not changed."""
_AXIS_95 = 1.959964
_PLANE_95 = math.sqrt(-2 * math.log(0.05))
"""95 % quantiles of a normal error along one axis, and of its length in the plane (Rayleigh)."""


class MixtureModel(LearnedModel):
    """A model that is one network from (B, ...) inputs to raw outputs (B, 7, anchors) of a mixture.

    It is trained by the likelihood of the true contacts. Its stated std are then scaled so that
    95 % of the errors on frames that it has not learned from lie inside the 95 % ellipses. A plate
    is the contact in which it meets the dome. A subclass calls ``_use_anchors`` before the model is
    used.
    """

    def __init__(
        self,
        context: ModelContext,
        recipe: Recipe,
        architecture: dict[str, Any],
        mixing: float = 0.0,
    ) -> None:
        super().__init__(context, recipe, architecture, mixing)
        self._plate = PlateScale()
        self._factors = _AS_STATED
        self._sensors: AlignedSensors | None = None

    @abstractmethod
    def read(self, outputs: Array) -> list[Contacts]:
        """Return the contacts of every row of ``outputs``, with the std that the network gives."""

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: tuple[Sequence[Frame], Sequence[Answer]],
        rng: np.random.Generator,
        progress: Progress,
    ) -> FitReport:
        """Train the model, then calibrate the std.

        The std are calibrated on the validation frames, on every twentieth of the given frames with
        several contacts, which is not learned from, and, if the model mixes, on as many new mixed
        frames.

        Raises:
            UserError: There is no frame that the model can learn from, mixed frames are requested
                and cannot be made, or the loss is not finite.
        """
        learned, held_out = split_calibration(truth)
        calibration = [*validation[0], *(frames[row] for row in held_out)]
        answers = [*validation[1], *(truth[row] for row in held_out)]
        report = super().fit(
            [frames[row] for row in learned],
            [truth[row] for row in learned],
            validation=(calibration, answers),
            rng=rng,
            progress=progress,
        )
        if self.mixing and calibration:  # other frames than those of the training
            from tactibench.superposition import mix

            mixed, contacts = mix(frames, truth, len(calibration), rng)
            calibration, answers = [*calibration, *mixed], [*answers, *contacts]
        if calibration:
            predicted = self.read(self.evaluate(calibration))
            true = [self._plate.contacts(answer) for answer in answers]
            self._factors = std_factors(predicted, true)
        notes = {"kept_for_std": len(held_out), "std_factors": self._factors.round(4).tolist()}
        return replace(report, notes={**report.notes, **notes})

    def prepare(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:  # noqa: ARG002
        """Find the scale of plate depths; std are as stated until they are calibrated."""
        self._factors = _AS_STATED
        self._plate = PlateScale.of(truth, self.context.max_depth)

    def targets(self, truth: Sequence[Answer]) -> torch.Tensor:
        """Return (N, K, 3) x, y and depth of the contacts, mm, rows of NaN for none."""
        return pack_contacts([self._plate.contacts(answer) for answer in truth])

    def loss(self, outputs: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        """Return the negative log likelihood of the true contacts."""
        anchors = self._anchors.to(outputs)
        return mixture_loss(outputs.flatten(2), anchors, targets, self._scale)

    def outputs(self, raw: torch.Tensor) -> Array:
        """Return (N, anchors, 7) float32: probability, mean and std of x, y and depth, mm."""
        anchors = self._anchors.to(raw.device)
        probability, mean, std = mixture_values(raw.flatten(2), anchors, self._scale)
        return super().outputs(torch.cat([probability[..., None], mean, std], dim=-1))

    def answers(self, outputs: Array) -> list[Answer | None]:
        """Return the contacts of every frame, or its plate pose (None without a contact)."""
        frames = [scale_std(contacts, self._factors) for contacts in self.read(outputs)]
        if self.context.answer == "plate":
            return [self._plate.plate(contacts) for contacts in frames]
        return list(frames)

    def extra(self) -> dict[str, Any]:
        """Return JSON values that are stored with the weights; a subclass adds its own."""
        return {"depth_offset_mm": self._plate.offset, "std_factors": self._factors.tolist()}

    def restore(self, extra: dict[str, Any]) -> None:
        """Restore the values that were stored with the weights."""
        self._plate = PlateScale(extra["depth_offset_mm"])
        self._factors = np.array(extra["std_factors"])

    def _find_sensors(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> AlignedSensors:
        """Return the sensors of a training; the first is that of the first frame with a rest image.

        Where no frame has a rest image, the frame that is pressed least is used as rest image.

        Raises:
            UserError: The image that is used shows no pins.
        """
        depths = [self._plate.contacts(answer).depth.sum() for answer in truth]
        return AlignedSensors.of(frames, otherwise=frames[int(np.argmin(depths))])

    def _tracks(self, frames: Sequence[Frame]) -> Tracks:
        """Return the pins of frames on the layout of the first training sensor.

        Raises:
            UserError: The model is not trained, or the pins of a sensor are not those of the
                layout.
        """
        if self._sensors is None:
            raise UserError(
                f"model {self.name!r} knows no pins yet; train it or load weights first."
            )
        return self._sensors.tracks(frames)

    def _use_anchors(self, anchors: npt.NDArray[np.float64], reach_mm: float) -> None:
        """Set the anchors.

        Args:
            anchors: (M, 2) mm.
            reach_mm: Largest distance of a mean from its anchor, in x and in y.
        """
        self._anchors = torch.from_numpy(anchors).float()
        self._scale = MixtureScale(reach_mm, self.context.max_depth)


def split_calibration(truth: Sequence[Answer]) -> tuple[Rows, Rows]:
    """Return rows to learn from, and rows with several contacts that are for ``std_factors``.

    The validation frames of a protocol hold single contacts, whose errors are of another size.
    """
    crowded = [isinstance(answer, Contacts) and len(answer) > 1 for answer in truth]
    held_out = np.flatnonzero(crowded)[_CALIBRATION_STEP - 1 :: _CALIBRATION_STEP]
    return np.setdiff1d(np.arange(len(truth)), held_out), held_out


def std_factors(predicted: Sequence[Contacts], truth: Sequence[Contacts]) -> Array:
    """Return the factors for the std of x, y and depth, (2, 3): of single and of several contacts.

    With them 95 % of the errors lie inside the 95 % ellipse in the plane and the 95 % interval of
    depth. Only frames with the right number of contacts are used. Where too few of them have
    several contacts, the factors of single contacts serve for both.

    Args:
        predicted: Predicted contacts of every frame, with the stated std.
        truth: True contacts of every frame.
    """
    pairs = [pair for pair in zip(predicted, truth, strict=True) if len(pair[0]) == len(pair[1])]
    alone = _factors([pair for pair in pairs if len(pair[0]) == 1], np.ones(3))
    return np.stack([alone, _factors([pair for pair in pairs if len(pair[0]) > 1], alone)])


def scale_std(contacts: Contacts, factors: Array) -> Contacts:
    """Return contacts with their std, if they have one, times the factors of ``std_factors``."""
    if contacts.std is None:
        return contacts
    return replace(contacts, std=contacts.std * factors[int(len(contacts) > 1)])


def _factors(pairs: Sequence[tuple[Contacts, Contacts]], default: Array) -> Array:
    z = np.concatenate([np.empty((0, 3)), *(_standardised(*pair) for pair in pairs)])
    if len(z) < _FEWEST:
        return default
    axes = np.maximum(np.quantile(np.abs(z), 0.95, axis=0) / _AXIS_95, 1e-3)
    plane = np.quantile(np.hypot(*(z[:, :2] / axes[:2]).T), 0.95) / _PLANE_95
    factors: Array = axes * [plane, plane, 1.0]
    return factors


def _standardised(predicted: Contacts, truth: Contacts) -> Array:
    """Return error / std of the prediction nearest to every true contact, (K, 3).

    There are no rows where the predictions have no std.
    """
    if predicted.std is None:
        return np.empty((0, 3))
    away = np.linalg.norm(predicted.xy[:, None] - truth.xy, axis=-1)
    nearest = away.argmin(axis=0)
    error = np.column_stack([predicted.xy, predicted.depth])[nearest] - np.column_stack(
        [truth.xy, truth.depth]
    )
    return np.asarray(error / predicted.std[nearest], dtype=np.float64)
