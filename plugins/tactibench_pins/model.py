"""The model ``pins``: frames -> displacements of the pins -> averaged networks -> one answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import torch

from tactibench import Answer, Frame, ModelContext, Stage
from tactibench.training import (
    ANSWER_WIDTH,
    Examples,
    LearnedModel,
    Normalisation,
    Recipe,
    answer_vectors,
    regression_rows,
)
from tactibench_pins.architecture import Members
from tactibench_pins.augmentation import move_presses
from tactibench_pins.displacements import (
    LATTICE,
    Channels,
    Components,
    Reader,
    contact_threshold,
    displacements,
    find_reader,
    read_answers,
    restored_reader,
)
from tactibench_pins.transfer import Correction, Differences

Array = npt.NDArray[np.float64]

RECIPE = Recipe(
    epochs=300,
    batch=128,
    learning_rate=3e-3,
    warmup=0.2,
    weight_decay=1e-2,
)
CHANNELS = replace(RECIPE, epochs=33)
"""Fewer epochs for channels: with the moved presses an epoch has nine times as many frames."""
_COMPONENTS = 40
"""Components of the displacements; further ones hold less than the pins' noise on real frames."""
_WHITENING = 0.5
_LAYERS = 3

TRANSFER = replace(RECIPE, epochs=80)
"""Fewer epochs for transfer to other sensors: details learned last are the trained sensor's own."""
_SHARED = 12
"""Components for transfer to other sensors; the next ones differ more between two sensors of one
make than between two presses."""
_BATCH = 32


class Pins(LearnedModel):
    """Regression of one answer from the displacements of all pins; no contact where they are small.

    A pin that was not seen stands where its neighbours say. The median is learned (the loss is the
    absolute error of the targets in standard deviations) by several networks, which differ in their
    first weights and in the noise that they are shown; the answer is their mean.
    """

    name = "pins"

    def __init__(
        self,
        context: ModelContext,
        members: int = 4,
        width: int = 256,
        epochs: int = 0,
        precision: str = "recipe",
    ) -> None:
        architecture = {"members": members, "width": width, "answer": context.answer}
        if context.transfers:
            architecture["transfers"] = True
        recipe = TRANSFER if context.transfers else RECIPE
        super().__init__(context, recipe.with_choices(epochs, precision), architecture)
        self._recipe_of_channels = CHANNELS.with_choices(epochs, precision)
        self._reader: Reader | None = None
        self._correction: Correction | None = None
        self._size, self._components = 2, 1
        self._threshold = 0.0
        count = ANSWER_WIDTH[context.answer]
        self._scale = Normalisation(np.zeros(count), np.ones(count))

    def build(self) -> Members:
        shape = self.architecture
        hidden = [shape["width"]] * _LAYERS
        sizes = [self._components, *hidden, ANSWER_WIDTH[self.context.answer]]
        return Members(
            self._size, sizes, shape["members"], self._reader is not None and self._reader.polar
        )

    def usable_rows(self, truth: Sequence[Answer]) -> npt.NDArray[np.int64]:
        return regression_rows(truth, self.context.answer, self.name)

    def prepare(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:
        targets = answer_vectors(truth, self.context.answer, self.name)
        self._scale = Normalisation.of(targets)
        self._reader = find_reader(frames, targets, self.context.transfers)
        self._size = self._reader.size
        if isinstance(self._reader, Channels):
            self.recipe = self._recipe_of_channels
        most = _SHARED if self.context.transfers else _COMPONENTS
        self._components = min(most, self._size + self._reader.polar, max(1, len(frames) - 1))

    def examples(
        self, frames: Sequence[Frame], truth: Sequence[Answer], rng: np.random.Generator
    ) -> Examples:
        """Return the frames and, for channels, presses that are moved from them."""
        examples = super().examples(frames, truth, rng)
        if not isinstance(self._reader, Channels):
            return examples
        targets, moved = move_presses(
            examples.targets.double().numpy(), examples.images.double().numpy(), rng
        )
        return Examples(
            torch.cat([examples.images, torch.from_numpy(moved).float()]),
            torch.cat([examples.targets, torch.from_numpy(targets).float()]),
        )

    def initialise(self, network: Members, training: Examples) -> None:
        moved = training.images.double().numpy()
        self._threshold = contact_threshold(moved, self.context.answer)
        assert self._reader is not None  # noqa: S101 - ``prepare`` came before
        components = Components.fit(moved, self._components, as_polar=self._reader.polar)
        network.initialise(components, _WHITENING, self._reader.noise)
        if self.context.transfers:
            network.show_differences(Differences.on(LATTICE))

    def inputs(self, frames: Sequence[Frame]) -> torch.Tensor:
        return torch.from_numpy(displacements(self._reader, frames, self.name)).float()

    def targets(self, truth: Sequence[Answer]) -> torch.Tensor:
        targets = answer_vectors(truth, self.context.answer, self.name)
        return torch.from_numpy(self._scale.apply(targets)).float()

    def loss(self, outputs: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        return (outputs[..., :-1] - targets[:, None]).abs().mean()

    def outputs(self, raw: torch.Tensor) -> npt.NDArray[Any]:
        """Return (B, T + 1): the mean over the members, mm and deg, and the rms displacement."""
        mean = raw.float().mean(dim=1).cpu().numpy()
        return np.column_stack([self._scale.invert(mean[:, :-1]), mean[:, -1]])

    def answers(self, outputs: npt.NDArray[Any]) -> list[Answer | None]:
        return read_answers(outputs, self.context.answer, self._threshold)

    def adapt(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> Mapping[str, Any]:
        """Fit a correction of the answers to labelled frames of another sensor (``Correction``).

        Frames that cannot be learned from are left out; where none is left, the answers are those
        of the trained model.

        Returns:
            Number of frames and ridge of every target, for the record.
        """
        self._correction = None
        rows = self.usable_rows(truth)
        if not len(rows):
            return {"frames": 0}
        targets = self._scale.apply(answer_vectors(truth, self.context.answer, self.name)[rows])
        features, raw, _ = self._features([frames[row] for row in rows])
        self._correction = Correction.fit(features, targets - raw)
        return {"frames": len(rows), "ridge": list(self._correction.ridges)}

    def evaluate(self, frames: Sequence[Frame]) -> npt.NDArray[Any]:
        """Return (N, T + 1): answers, mm and deg, corrected by ``adapt``, and rms displacements."""
        if self._correction is None:
            return super().evaluate(frames)
        features, raw, rms = self._features(frames)
        return np.column_stack([self._scale.invert(raw + self._correction(features)), rms])

    def stages(self) -> Sequence[Stage]:
        """Return the phases of the network, or those of the corrected answers in float32."""
        if self._correction is None:
            return super().stages()
        return [("forward", self.evaluate), ("decode", self.answers)]

    @torch.inference_mode()
    def _features(self, frames: Sequence[Frame]) -> tuple[Array, Array, Array]:
        """Return last hidden layers (N, M U), normalised raw answers (N, T), and rms (N,)."""
        network = cast("Members", self.network)
        features, raw = [], []
        for start in range(0, len(frames), _BATCH):
            batch = self.inputs(frames[start : start + _BATCH]).to(self.context.device)
            hidden = network.hidden(batch)
            features.append(hidden.transpose(0, 1).flatten(1).double().cpu().numpy())
            raw.append(network(batch).mean(dim=1).double().cpu().numpy())
        outputs = np.concatenate(raw)
        return np.concatenate(features), outputs[:, :-1], outputs[:, -1]

    def extra(self) -> dict[str, Any]:
        return {
            **({"rest": None} if self._reader is None else self._reader.saved()),
            "components": self._components,
            "scale": self._scale.to_json(),
            "least": self._threshold,
        }

    def restore(self, extra: dict[str, Any]) -> None:
        self._reader = restored_reader(extra, self.context.transfers)
        self._size = 2 if self._reader is None else self._reader.size
        self._components = extra["components"]
        self._scale = Normalisation.from_json(extra["scale"])
        self._threshold = extra["least"]
