"""What models share whose network gives a mixture of Gaussians, one of each anchor."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from tactibench.contacts import Answer, Contacts, Frame
from tactibench.plugins.base import FitReport, ModelContext, Progress
from tactibench.superposition import Eye
from tactibench.training.calibration import held_back, scale_std, std_factors
from tactibench.training.learned import LearnedModel
from tactibench.training.mixture import MixtureScale, mixture_loss, mixture_values, pack_contacts
from tactibench.training.recipe import Recipe
from tactibench.training.targets import PlateScale

Array = npt.NDArray[Any]

_AS_STATED = np.ones((2, 3))


class MixtureModel(LearnedModel):
    """A model that is one network (B, ...) -> raw outputs (B, 7, anchors) of a mixture.

    It is trained by the likelihood of the true contacts. The std that it states are then scaled so
    that 95 % of the errors on frames it has not learned from lie inside the 95 % ellipses. A plate
    is the contact in which it meets the dome. A subclass calls ``_use_anchors`` before it is used.
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

    # What a subclass gives.

    @abstractmethod
    def read(self, outputs: Array) -> list[Contacts]:
        """Contacts of every row of what ``outputs`` gave, with the std as the network states it."""

    # What it gives them.

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: tuple[Sequence[Frame], Sequence[Answer]],
        rng: np.random.Generator,
        progress: Progress,
    ) -> FitReport:
        """Train, then scale the std. Frames with several contacts are kept back for the latter:
        one of twenty of those given, and as many new mixtures as validation frames if it mixes."""
        used, kept = held_back(truth)
        seen = [*validation[0], *(frames[row] for row in kept)]
        known = [*validation[1], *(truth[row] for row in kept)]
        report = super().fit(
            [frames[row] for row in used],
            [truth[row] for row in used],
            validation=(seen, known),
            rng=rng,
            progress=progress,
        )
        if self.mixing and seen:  # other frames than those that were learned from
            from tactibench.superposition import mix

            mixed, contacts = mix(frames, truth, len(seen), rng)
            seen, known = [*seen, *mixed], [*known, *contacts]
        if seen:
            found = self.read(self.evaluate(seen))
            self._factors = std_factors(found, [self._plate.contacts(one) for one in known])
        notes = {"kept_for_std": len(kept), "std_factors": self._factors.round(4).tolist()}
        return replace(report, notes={**report.notes, **notes})

    def prepare(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:  # noqa: ARG002
        self._factors = _AS_STATED
        self._plate = PlateScale.of(truth, self.context.max_depth)

    def targets(self, truth: Sequence[Answer]) -> torch.Tensor:
        """(N, K, 3) x, y and depth of the contacts, mm, rows of NaN for none."""
        return pack_contacts([self._plate.contacts(answer) for answer in truth])

    def loss(self, outputs: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        anchors = self._anchors.to(outputs)
        return mixture_loss(outputs.flatten(2), anchors, targets, self._scale)

    def outputs(self, raw: torch.Tensor) -> Array:
        """(N, anchors, 7) float32: probability, mean and std of x, y and depth, mm."""
        anchors = self._anchors.to(raw.device)
        probability, mean, std = mixture_values(raw.flatten(2), anchors, self._scale)
        return super().outputs(torch.cat([probability[..., None], mean, std], dim=-1))

    def answers(self, outputs: Array) -> list[Answer | None]:
        """Contacts of every frame, or its plate pose (None where there is no contact)."""
        found = [scale_std(contacts, self._factors) for contacts in self.read(outputs)]
        if self.context.answer == "plate":
            return [self._plate.plate(contacts) for contacts in found]
        return list(found)

    def extra(self) -> dict[str, Any]:
        """JSON values kept beside the weights; a subclass adds its own."""
        return {"depth_offset_mm": self._plate.offset, "std_factors": self._factors.tolist()}

    def use_extra(self, extra: dict[str, Any]) -> None:
        self._plate = PlateScale(extra["depth_offset_mm"])
        self._factors = np.array(extra["std_factors"])

    def _resting_eye(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> Eye:
        """Follows the pins from their places in the rest image of the first frame that has one, or
        else in the frame that is pressed least."""
        depths = [self._plate.contacts(answer).depth.sum() for answer in truth]
        return Eye.of(frames, otherwise=frames[int(np.argmin(depths))])

    def _use_anchors(self, anchors: npt.NDArray[np.float64], reach_mm: float) -> None:
        """anchors: (M, 2) mm. reach_mm: how far from its anchor a mean may lie, in x and in y."""
        self._anchors = torch.from_numpy(anchors).float()
        self._scale = MixtureScale(reach_mm, self.context.max_depth)
