"""What all models that are one network share: fit, predict, timed stages, weights on disk."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
import torch
from torch import nn

from tactibench.contacts import Answer, Contacts, Frame
from tactibench.errors import UserError
from tactibench.plugins.base import FitReport, Model, ModelContext, Progress
from tactibench.training.deploy import CONFIGURATIONS, Unavailable, deployed
from tactibench.training.examples import Examples
from tactibench.training.fold import fold_batch_norm
from tactibench.training.loop import train
from tactibench.training.network import count_flops, count_parameters
from tactibench.training.precision import autocast, repeatable, resolve_precision
from tactibench.training.recipe import Recipe
from tactibench.training.seeds import Seeds, seeded
from tactibench.training.targets import position_error_mm
from tactibench.training.weights import load_weights, save_weights

Array = npt.NDArray[Any]

_BATCH = 32
"""Frames that pass the network at once in ``predict``."""


class LearnedModel(Model):
    """A model that is one network: a subclass says what goes in, what comes out and the loss.

    context, recipe: as handed to the model. architecture: JSON values that determine the shape of
    the network; weights of any other are refused. mixing: frames with several contacts that
    ``fit`` makes from the single presses among its frames, as a share of the frames.
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
        precision = resolve_precision("auto", context.device)
        self.timed_as = f"{precision}, batch 1, normalisation folded, channels_last"
        self._network: nn.Module | None = None
        self._folded: dict[str, nn.Module] = {}

    # What a subclass gives.

    @abstractmethod
    def build(self) -> nn.Module:
        """A fresh network: what ``inputs`` gives -> raw outputs (B, ...). Called under a seed."""

    @abstractmethod
    def inputs(self, frames: Sequence[Frame]) -> torch.Tensor:
        """(N, ...) uint8 images or float features, on the CPU."""

    @abstractmethod
    def targets(self, truth: Sequence[Answer]) -> torch.Tensor:
        """(N, ...) what the network is to learn, on the CPU."""

    @abstractmethod
    def loss(self, outputs: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        """Scalar from raw outputs (logits) and targets, both float32."""

    @abstractmethod
    def answers(self, outputs: Array) -> list[Answer | None]:
        """One answer per row of what ``outputs`` gave."""

    # What a subclass may override.

    def outputs(self, raw: torch.Tensor) -> Array:
        """Raw outputs of the network as the numbers that ``answers`` reads, on the CPU."""
        array: Array = raw.float().cpu().numpy()
        return array

    def error_mm(self, found: Sequence[Answer | None], truth: Sequence[Answer]) -> float | None:
        """The error of validation frames that a progress bar shows, mm."""
        return position_error_mm(found, truth)

    def usable(self, truth: Sequence[Answer]) -> npt.NDArray[np.int64]:
        """Rows that can be learned from; the others are left out and counted."""
        return np.arange(len(truth))

    def blanks(self, frames: Sequence[Frame]) -> list[Frame]:  # noqa: ARG002
        """Frames without a contact to learn from besides those given."""
        return []

    def prepare(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:
        """Learn what inputs and targets need (scales, a rest layout) before the training."""

    def start(self, network: Any, training: Examples) -> None:
        """Set what is known of the network's state before the first step."""

    def extra(self) -> dict[str, Any]:
        """JSON values of ``prepare`` that are kept beside the weights."""
        return {}

    def use_extra(self, extra: dict[str, Any]) -> None:
        """Take back what ``extra`` gave."""

    def fold(self, network: nn.Module, precision: str) -> nn.Module:
        """A copy for inference in "float32" or "bf16" (called under autocast in the latter)."""
        return fold_batch_norm(network, precision)

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
        """Train; same rng state, same weights. Raises UserError for frames it cannot learn from."""
        seeds = Seeds.draw(rng)
        given = len(frames)
        frames, truth = self._usable(frames, truth)
        if not frames:
            raise UserError(
                f"model {self.name!r} was given no training frame that it can learn from; "
                "raise the training count."
            )
        notes: dict[str, Any] = {}
        if len(frames) < given:
            notes["without_contact"] = given - len(frames)
        blanks = self.blanks(frames)
        frames, truth = [*frames, *blanks], [*truth, *(Contacts.none() for _ in blanks)]
        if self.mixing:
            from tactibench.superposition import mix

            mixed, contacts = mix(frames, truth, round(self.mixing * len(frames)), rng)
            notes["mixed"] = len(mixed)
            frames, truth = [*frames, *mixed], [*truth, *contacts]
        self.prepare(frames, truth)
        training = Examples(self.inputs(frames), self.targets(truth))
        seen, wanted = self._usable(*validation)
        held_out = Examples(self.inputs(seen), self.targets(wanted))
        network = self._built(seeds.init)
        self.start(network, training)

        def error_mm(raw: torch.Tensor, rows: npt.NDArray[np.int64]) -> float | None:
            return self.error_mm(self.answers(self.outputs(raw)), [wanted[row] for row in rows])

        report = train(
            network,
            training,
            held_out,
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
        """One answer per frame, computed in float32."""
        return self.answers(self.evaluate(frames)) if frames else []

    @torch.inference_mode()
    def evaluate(self, frames: Sequence[Frame]) -> Array:
        """(N, ...) outputs, computed in float32."""
        starts = range(0, max(1, len(frames)), _BATCH)
        batches = (self.inputs(frames[start : start + _BATCH]) for start in starts)
        return np.concatenate([self._forward(batch, "float32") for batch in batches])

    def stages(self) -> list[tuple[str, Callable[[Any], Any]]]:
        """Phases of the fast configuration: bf16 where the device computes it natively."""
        precision = resolve_precision("auto", self.context.device)
        self._inference(precision)
        return [
            ("preprocess", self.inputs),
            ("forward", lambda inputs: self._forward(inputs, precision)),
            ("decode", self.answers),
        ]

    def configured(
        self, name: str, frames: Sequence[Frame]
    ) -> list[tuple[str, Callable[[Any], Any]]]:
        """Phases of one way. Raises UserError with the reason where this machine cannot go it."""
        example, device = self.inputs(frames), self.context.device
        try:
            forward = deployed(name, self.network, self.fold, example, device)
        except Unavailable as reason:
            raise UserError(f"model {self.name!r}, {CONFIGURATIONS[name]}: {reason}.") from reason
        return [
            ("preprocess", self.inputs),
            ("forward", lambda inputs: self.outputs(forward(inputs))),
            ("decode", self.answers),
        ]

    def fast_predict(self, frames: Sequence[Frame]) -> list[Answer | None]:
        """The stages one after the other."""
        value: Any = frames
        for _, stage in self.stages():
            value = stage(value)
        return list(value)

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
        """Read weights. Raises UserError for those of another model or architecture."""
        tensors, extra = load_weights(directory, model=self.name, architecture=self.architecture)
        self.use_extra(extra)
        network = self._built(seed=0)
        network.load_state_dict(tensors)
        self._use(network)

    @property
    def network(self) -> nn.Module:
        """The network as trained or loaded; before that, one with weights of seed 0."""
        if self._network is None:
            return self._use(self._built(seed=0))
        return self._network

    def parameter_count(self) -> int:
        """Return the number of trained weights."""
        return count_parameters(self.network)

    def flops(self, frame: Frame) -> int | None:
        """Floating-point operations of a forward pass of one frame."""
        return count_flops(self.network, self.inputs([frame]).to(self.context.device))

    def _built(self, seed: int) -> nn.Module:
        with seeded(seed):
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
        with repeatable(device, precision), autocast(precision, device):
            raw = network(inputs.to(device))
        return self.outputs(raw)

    def _usable(
        self, frames: Sequence[Frame], truth: Sequence[Answer]
    ) -> tuple[list[Frame], list[Answer]]:
        rows = self.usable(truth)
        return [frames[row] for row in rows], [truth[row] for row in rows]
