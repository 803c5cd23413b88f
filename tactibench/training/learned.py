"""The base of models that are one network: fit, predict, timed stages, weights on disk."""

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
from tactibench.plugins.base import Model, ModelContext, Progress, Stage
from tactibench.plugins.fit_report import FitReport, Prior
from tactibench.training.examples import Examples
from tactibench.training.inference import (
    CONFIGURATIONS,
    autocast,
    deterministic_kernels,
    fold_batch_norm,
)
from tactibench.training.loop import train
from tactibench.training.precision import resolve_precision
from tactibench.training.recipe import Recipe, Seeds, torch_seed
from tactibench.training.targets import position_error_mm
from tactibench.training.weights import load_weights, save_weights

Array = npt.NDArray[Any]

USUAL_MIXING = 0.5
"""Mixed frames a frame. As many as frames cost half as much time again: pairs are then resolved as
often (99.9 against 99.7 %), and their distance is no nearer (0.135 mm)."""
_BATCH = 32
"""Frames that pass the network at once in ``predict``."""


class LearnedModel(Model):
    """A model that is one network: a subclass says what goes in, what comes out and the loss.

    Attributes:
        context: as handed to the model.
        recipe: of its training.
        architecture: JSON values that determine the shape of the network; weights of any other are
            refused.
        mixing: frames with several contacts that ``fit`` makes from the single presses among its
            frames, as a share of the frames; below 0: ``USUAL_MIXING``, where the frames
            allow it.
        prior: what mixed frames know of contacts that press together.
    """

    name: ClassVar[str]
    """The name the model is declared by."""
    configurations = CONFIGURATIONS

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
        self.prior: Prior = "nominal mechanics"
        precision = resolve_precision("auto", context.device)
        self.timed_as = f"{precision}, batch 1, normalisation folded, channels_last"
        self._network: nn.Module | None = None
        self._folded: dict[str, nn.Module] = {}

    # Methods that a subclass must define.

    @abstractmethod
    def build(self) -> nn.Module:
        """Return a fresh network, ``inputs`` -> raw outputs (B, ...). Called under a seed."""

    @abstractmethod
    def inputs(self, frames: Sequence[Frame]) -> torch.Tensor:
        """Return (N, ...) uint8 images or float features, on the CPU."""

    @abstractmethod
    def targets(self, truth: Sequence[Answer]) -> torch.Tensor:
        """Return (N, ...) values that the network is to learn, on the CPU."""

    @abstractmethod
    def loss(self, outputs: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        """Return a scalar from raw outputs (logits) and targets, both float32."""

    @abstractmethod
    def answers(self, outputs: Array) -> list[Answer | None]:
        """Return one answer a row of ``outputs``."""

    # Methods that a subclass may override.

    def outputs(self, raw: torch.Tensor) -> Array:
        """Return raw outputs of the network as the numbers that ``answers`` reads, on the CPU."""
        array: Array = raw.float().cpu().numpy()
        return array

    def mix(
        self, frames: Sequence[Frame], truth: Sequence[Answer], count: int, rng: np.random.Generator
    ) -> tuple[list[Frame], list[Contacts]]:
        """Return ``count`` frames with several contacts made of the single presses, their truth.

        Raises:
            UserError: for frames of which none can be made.
        """
        from tactibench.superposition import mix

        return mix(frames, truth, count, rng)

    def usable_rows(self, truth: Sequence[Answer]) -> npt.NDArray[np.int64]:
        """Return the rows that can be learned from; the others are left out and counted."""
        return np.arange(len(truth))

    def empty_frames(self, frames: Sequence[Frame]) -> list[Frame]:  # noqa: ARG002
        """Return frames without a contact to learn from besides those given."""
        return []

    def prepare(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:
        """Learn what inputs and targets need (scales, a rest layout) before the training."""

    def examples(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        rng: np.random.Generator,  # noqa: ARG002
    ) -> Examples:
        """Return what the network learns from, after ``prepare``; a subclass may add to it."""
        return Examples(self.inputs(frames), self.targets(truth))

    def initialise(self, network: Any, training: Examples) -> None:
        """Set what is known of the network's state before the first step."""

    def extra(self) -> dict[str, Any]:
        """Return JSON values of ``prepare`` that are kept beside the weights."""
        return {}

    def restore(self, extra: dict[str, Any]) -> None:
        """Take back the values of ``extra``."""

    def fold(self, network: nn.Module, precision: str) -> nn.Module:
        """Return a copy for inference in "float32" or, called under autocast, in "bf16"."""
        return fold_batch_norm(network, precision)

    # Methods that it defines.

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: tuple[Sequence[Frame], Sequence[Answer]],
        rng: np.random.Generator,
        progress: Progress,
    ) -> FitReport:
        """Train; the same rng state gives the same weights.

        Raises:
            UserError: for frames that it cannot learn from.
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
        prior: Prior = self.prior if mixed else "none"
        return replace(report, prior=prior, notes={**report.notes, **notes})

    def predict(self, frames: Sequence[Frame]) -> list[Answer | None]:
        """Return one answer a frame, computed in float32."""
        return self.answers(self.evaluate(frames)) if frames else []

    @torch.inference_mode()
    def evaluate(self, frames: Sequence[Frame]) -> Array:
        """Return (N, ...) outputs, computed in float32."""
        starts = range(0, max(1, len(frames)), _BATCH)
        batches = (self.inputs(frames[start : start + _BATCH]) for start in starts)
        return np.concatenate([self._forward(batch, "float32") for batch in batches])

    def stages(self) -> Sequence[Stage]:
        """Return the phases of the fast configuration: bf16 where the device has it natively."""
        precision = resolve_precision("auto", self.context.device)
        self._inference(precision)
        return [
            ("preprocess", self.inputs),
            ("forward", lambda inputs: self._forward(inputs, precision)),
            ("decode", self.answers),
        ]

    def configured(self, name: str, frames: Sequence[Frame]) -> Sequence[Stage]:
        """Return the phases of one way of ``configurations``, made ready for frames like these.

        Raises:
            UserError: with the reason where this machine cannot compute that way.
        """
        from tactibench.training.deploy import UnavailableError, prepare_forward

        example, device = self.inputs(frames), self.context.device
        try:
            forward = prepare_forward(name, self.network, self.fold, example, device)
        except UnavailableError as reason:
            raise UserError(f"model {self.name!r}, {CONFIGURATIONS[name]}: {reason}.") from reason
        return [
            ("preprocess", self.inputs),
            ("forward", lambda inputs: self.outputs(forward(inputs))),
            ("decode", self.answers),
        ]

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
            UserError: for those of another model or architecture.
        """
        tensors, extra = load_weights(directory, model=self.name, architecture=self.architecture)
        self.restore(extra)
        network = self._build(seed=0)
        network.load_state_dict(tensors)
        self._use(network)

    @property
    def network(self) -> nn.Module:
        """The network as trained or loaded; before that, one with weights of seed 0."""
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
        with torch.no_grad(), counter:
            self.network(inputs)
        return int(counter.get_total_flops())

    def _mixtures(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        rng: np.random.Generator,
        notes: dict[str, Any],
    ) -> tuple[list[Frame], list[Contacts]]:
        """Return the frames that ``mixing`` asks for; ``notes`` is told how many, or why none."""
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
        with torch_seed(seed):
            return self.build()

    def _use(self, network: nn.Module) -> nn.Module:
        self._network = network.to(self.context.device).eval()
        self._folded = {}
        return self._network

    def _inference(self, precision: str) -> nn.Module:
        if precision not in self._folded:
            self._folded[precision] = self.fold(self.network, precision)
        return self._folded[precision]

    @torch.inference_mode()
    def _forward(self, inputs: torch.Tensor, precision: str) -> Array:
        device = self.context.device
        network = self._inference(precision)
        with deterministic_kernels(device, precision), autocast(precision, device):
            raw = network(inputs.to(device))
        return self.outputs(raw)

    def _usable(
        self, frames: Sequence[Frame], truth: Sequence[Answer]
    ) -> tuple[list[Frame], list[Answer]]:
        rows = self.usable_rows(truth)
        return [frames[row] for row in rows], [truth[row] for row in rows]
