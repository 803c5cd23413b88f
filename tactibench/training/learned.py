"""The base class of models that are one network: fit, predict, timed stages, weights on disk."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
import torch
from torch import nn

from tactibench.contacts import Answer, Contacts, Frame
from tactibench.errors import UserError
from tactibench.plugins import FitReport, Model, ModelContext, Progress, Stage
from tactibench.training.inference import (
    deterministic_kernels,
    float32_tensors,
    fold_batch_norm,
)
from tactibench.training.loop import train
from tactibench.training.recipe import Recipe, Seeds, torch_seed
from tactibench.training.targets import Examples, position_error_mm
from tactibench.training.weights import load_weights, save_weights

Array = npt.NDArray[Any]

USUAL_MIXING = 0.5
"""Mixed frames as a share of the frames. A share of 1 costs half as much time again: pairs are then
resolved as often (99.9 against 99.7 %), and their distance is no better (0.135 mm)."""
_BATCH = 32
"""Frames that pass through the network at once, to bound the memory."""


class LearnedModel(Model):
    """A model that is one network: a subclass defines its inputs, its answers and the loss.

    Attributes:
        context: The context in which the model was built.
        recipe: Recipe of its training.
        architecture: JSON values that determine the shape of the network; weights with other values
            are refused.
        mixing: Number of frames with several contacts that ``fit`` makes from the single presses
            among its frames, as a share of the frames. Below 0 it is ``USUAL_MIXING`` where the
            frames allow it.
    """

    name: ClassVar[str]
    """The name by which the model is declared."""

    def __init__(
        self,
        context: ModelContext,
        recipe: Recipe,
        architecture: dict[str, Any],
        mixing: float = 0.0,
    ) -> None:
        self.context = context
        self.recipe = recipe
        self.architecture = architecture
        self.mixing = mixing
        self._network: nn.Module | None = None
        self._folded: nn.Module | None = None

    @abstractmethod
    def build(self) -> nn.Module:
        """Return a fresh network from ``inputs`` to raw outputs (B, ...).

        It is called under a seed.
        """

    @abstractmethod
    def inputs(self, frames: Sequence[Frame]) -> torch.Tensor:
        """Return the inputs of the network, (N, ...) uint8 images or float features, on the CPU."""

    @abstractmethod
    def targets(self, truth: Sequence[Answer]) -> torch.Tensor:
        """Return the (N, ...) values that the network learns, on the CPU."""

    @abstractmethod
    def loss(self, outputs: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        """Return the loss, a scalar, of raw outputs (logits) and targets, both float32."""

    @abstractmethod
    def answers(self, outputs: Array) -> list[Answer | None]:
        """Return one answer for every row of ``outputs``."""

    # Methods that a subclass may override.

    def outputs(self, raw: torch.Tensor) -> Array:
        """Return the numbers that ``answers`` reads, on the CPU, from raw outputs."""
        array: Array = raw.float().cpu().numpy()
        return array

    def mix(
        self, frames: Sequence[Frame], truth: Sequence[Answer], count: int, rng: np.random.Generator
    ) -> tuple[list[Frame], list[Contacts]]:
        """Return frames with several contacts, made from single presses, and their truth.

        Args:
            frames: Frames, of which those with a single contact are used.
            truth: True answers to the frames.
            count: Number of new frames.
            rng: Random numbers.

        Raises:
            UserError: Such frames cannot be made from these frames.
        """
        from tactibench.superposition import mix

        return mix(frames, truth, count, rng)

    def usable_rows(self, truth: Sequence[Answer]) -> npt.NDArray[np.int64]:
        """Return the rows that the model can learn from; the others are left out and counted."""
        return np.arange(len(truth))

    def empty_frames(self, frames: Sequence[Frame]) -> list[Frame]:  # noqa: ARG002
        """Return additional frames without a contact to learn from."""
        return []

    def prepare(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:
        """Learn what inputs and targets need, such as scales or a rest layout, before training."""

    def examples(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        rng: np.random.Generator,  # noqa: ARG002
    ) -> Examples:
        """Return the examples of the training, after ``prepare``; a subclass may add to them.

        Args:
            frames: Training frames.
            truth: True answers to the frames.
            rng: Random numbers.
        """
        return Examples(self.inputs(frames), self.targets(truth))

    def initialise(self, network: Any, training: Examples) -> None:
        """Set weights of the network that are known before the first step."""

    def extra(self) -> dict[str, Any]:
        """Return JSON values of ``prepare`` that are stored with the weights."""
        return {}

    def restore(self, extra: dict[str, Any]) -> None:
        """Restore the values of ``extra``."""

    def fold(self, network: nn.Module) -> nn.Module:
        """Return a copy of the network for inference."""
        return fold_batch_norm(network)

    # Methods that this class defines.

    @float32_tensors()
    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: tuple[Sequence[Frame], Sequence[Answer]],
        rng: np.random.Generator,
        progress: Progress,
    ) -> FitReport:
        """Train the model; the same state of ``rng`` gives the same weights.

        Raises:
            UserError: There is no frame that the model can learn from, mixed frames are requested
                and cannot be made, or the loss is not finite.
        """
        seeds = Seeds.draw(rng)
        count = len(frames)
        frames, truth = self._usable(frames, truth)
        if not frames:
            raise UserError(
                f"model {self.name!r} was given no training frame that it can learn from; "
                "raise the training count."
            )
        notes: dict[str, Any] = {}
        if len(frames) < count:
            notes["without_contact"] = count - len(frames)
        empty = self.empty_frames(frames)
        frames, truth = [*frames, *empty], [*truth, *(Contacts.none() for _ in empty)]
        mixed, contacts = self._mixtures(frames, truth, rng, notes)
        frames, truth = [*frames, *mixed], [*truth, *contacts]
        self.prepare(frames, truth)
        training = self.examples(frames, truth, rng)
        held_out, held_out_truth = self._usable(*validation)
        network = self._build(seeds.init)
        self.initialise(network, training)

        def error_mm(raw: torch.Tensor, rows: npt.NDArray[np.int64]) -> float | None:
            predicted = self.answers(self.outputs(raw))
            return position_error_mm(predicted, [held_out_truth[row] for row in rows])

        report = train(
            network,
            training,
            Examples(self.inputs(held_out), self.targets(held_out_truth)),
            recipe=self.recipe,
            loss=self.loss,
            error_mm=error_mm,
            seeds=seeds,
            identity={"model": self.name, **self.architecture, **self.extra()},
            progress=progress,
            device=self.context.device,
            checkpoints=self.context.checkpoints,
        )
        self._use(network)
        return replace(report, notes={**report.notes, **notes})

    def predict(self, frames: Sequence[Frame]) -> list[Answer | None]:
        """Return one answer for every frame: the stages in turn."""
        if not frames:
            return []
        value: Any = frames
        for _, stage in self.stages():
            value = stage(value)
        answers: list[Answer | None] = value
        return answers

    def stages(self) -> Sequence[Stage]:
        """Return the phases of ``predict``, which computes in float32."""
        return [
            ("preprocess", self.inputs),
            ("forward", self.forward),
            ("decode", self.answers),
        ]

    @torch.inference_mode()
    def forward(self, inputs: torch.Tensor) -> Array:
        """Return the (N, ...) outputs of (N, ...) inputs, computed in float32."""
        if self._folded is None:
            self._folded = self.fold(self.network)
        device = self.context.device
        with float32_tensors(), deterministic_kernels(device):
            batches = torch.split(inputs, _BATCH)
            outputs = [self.outputs(self._folded(batch.to(device))) for batch in batches]
        return np.concatenate(outputs)

    def evaluate(self, frames: Sequence[Frame]) -> Array:
        """Return the (N, ...) outputs of frames."""
        return self.forward(self.inputs(frames))

    def save(self, directory: Path) -> None:
        """Write the weights into the folder."""
        save_weights(
            directory,
            self.network.state_dict(),
            model=self.name,
            architecture=self.architecture,
            extra=self.extra(),
        )

    def load(self, directory: Path) -> None:
        """Read weights from the folder.

        Raises:
            UserError: The weights are missing or damaged, or belong to another model or
                architecture.
        """
        tensors, extra = load_weights(directory, model=self.name, architecture=self.architecture)
        self.restore(extra)
        network = self._build(seed=0)
        network.load_state_dict(tensors)
        self._use(network)

    @property
    def network(self) -> nn.Module:
        """The trained or loaded network; before training, a network with weights of seed 0."""
        if self._network is None:
            return self._use(self._build(seed=0))
        return self._network

    def parameter_count(self) -> int:
        """Return the number of trained weights."""
        return sum(weight.numel() for weight in self.network.parameters())

    def flops(self, frame: Frame) -> int | None:
        """Return the floating-point operations of a forward pass of one frame.

        A product and a sum count as two. Convolutions and matrix products are counted; sums,
        activations and poolings are not.
        """
        from torch.utils.flop_counter import FlopCounterMode

        inputs = self.inputs([frame]).to(self.context.device)
        counter = FlopCounterMode(display=False)
        with torch.no_grad(), float32_tensors(), counter:
            self.network(inputs)
        return int(counter.get_total_flops())

    def _mixtures(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        rng: np.random.Generator,
        notes: dict[str, Any],
    ) -> tuple[list[Frame], list[Contacts]]:
        """Return the mixed frames and their truth.

        Their number, or why there are none, is added to ``notes``.

        Raises:
            UserError: Mixed frames are requested and cannot be made.
        """
        if not self.mixing:
            return [], []
        share = self.mixing if self.mixing > 0 else USUAL_MIXING
        try:
            mixed, contacts = self.mix(frames, truth, round(share * len(frames)), rng)
        except UserError as error:
            if self.mixing > 0:
                raise
            notes["not_mixed"] = str(error)
            return [], []
        notes |= {"mixing": share, "mixed": len(mixed)}
        return mixed, contacts

    def _build(self, seed: int) -> nn.Module:
        with torch_seed(seed), float32_tensors():
            return self.build()

    def _use(self, network: nn.Module) -> nn.Module:
        self._network, self._folded = network.to(self.context.device).eval(), None
        return self._network

    def _usable(
        self, frames: Sequence[Frame], truth: Sequence[Answer]
    ) -> tuple[list[Frame], list[Answer]]:
        rows = self.usable_rows(truth)
        return [frames[row] for row in rows], [truth[row] for row in rows]
