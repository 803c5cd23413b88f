"""The model ``pins``: frames -> displacements of the pins -> averaged networks -> one answer.

Several dense networks in one: all members take a batch in one product a layer.

Channels of a skin are read by the field that they follow, see ``field``.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import torch
from torch import nn
from torch.nn import functional as F  # noqa: N812

from tactibench import (
    Answer,
    FitReport,
    Frame,
    ModelContext,
    Progress,
    Stage,
    UserError,
    holds_channels,
)
from tactibench.training import (
    ANSWER_WIDTH,
    Examples,
    LearnedModel,
    Normalisation,
    Recipe,
    answer_vectors,
    regression_rows,
)
from tactibench_pins.displacements import (
    LATTICE,
    Channels,
    Components,
    Correction,
    Differences,
    Reader,
    contact_threshold,
    displacements,
    find_reader,
    known_targets,
    polar,
    read_answers,
    restored_reader,
)
from tactibench_pins.field import FEWEST, MOST, SHRINKAGES, ForwardModel, Inversion

_LAST = 0.1
"""Factor on the usual size of the last layer's first weights, so that answers start near the
mean."""


class Members(nn.Module):
    """Networks from (B, 2 P) displacements, px, to (B, M, T + 1) targets and rms displacement.

    The displacements are first turned into K whitened components. While it trains, every member
    sees them with noise of its own, as if every pin had been found that much elsewhere. Hidden
    layers after the first are residual: h <- (h + gelu(W h + b)) / sqrt 2. With
    ``show_differences`` each frame is also shown as other sensors might see it.
    """

    mean: torch.Tensor
    basis: torch.Tensor
    noise: torch.Tensor
    differences: torch.Tensor

    def __init__(self, size: int, sizes: Sequence[int], members: int) -> None:
        """Make ``members`` networks.

        Args:
            size: Numbers of a frame, 2 P.
            sizes: K, units of the hidden layers, T.
            members: M.
        """
        super().__init__()
        self.members = members
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("basis", torch.zeros(size, sizes[0]))
        self.register_buffer("noise", torch.zeros(sizes[0]))
        self.register_buffer("differences", torch.zeros(0, 0), persistent=False)
        self.weights = nn.ParameterList()
        self.biases = nn.ParameterList()
        for number, (inside, outside) in enumerate(pairwise(sizes)):
            last = number == len(sizes) - 2
            spread = math.sqrt(2 / inside) * (_LAST if last else 1.0)
            self.weights.append(nn.Parameter(spread * torch.randn(members, inside, outside)))
            self.biases.append(nn.Parameter(torch.zeros(members * outside)))  # no weight decay

    @torch.no_grad()
    def initialise(self, components: Components, whitening: float, noise: float) -> None:
        """Fix the components of displacements.

        Args:
            components: Components of the training frames.
            whitening: Power of the spreads, see ``Components.weights``.
            noise: Deviation of one number of a frame.
        """
        weights = torch.from_numpy(components.weights(whitening)).float()
        count = len(components)  # frames that hardly differ have fewer than K
        self.mean.copy_(torch.from_numpy(components.mean))
        self.basis[:, :count] = torch.from_numpy(components.basis).float() * weights
        self.noise[:count] = noise * weights

    @torch.no_grad()
    def show_differences(self, differences: Differences) -> None:
        """Show smooth differences of fields in the training; to be called after ``initialise``."""
        factor = differences.of_components(self.basis.cpu().double().numpy())
        self.differences = torch.from_numpy(factor).to(self.basis)

    def forward(self, moved: torch.Tensor) -> torch.Tensor:
        hidden = self.hidden(moved)
        bias = self.biases[-1].view(self.members, 1, -1)
        values = torch.baddbmm(bias, hidden, self.weights[-1]).transpose(0, 1)
        rms = moved.square().mean(dim=1).sqrt()[:, None, None].expand(-1, self.members, 1)
        return torch.cat([values, rms.to(values)], dim=2)

    def hidden(self, moved: torch.Tensor) -> torch.Tensor:
        """Return the last hidden layer (M, B, U) of every member."""
        hidden = ((moved - self.mean) @ self.basis).expand(self.members, -1, -1)
        if self.training:
            hidden = hidden + self.noise * torch.randn_like(hidden)
            if len(self.differences):
                rms = moved.square().mean(dim=1).sqrt()[:, None]
                hidden = hidden + rms * (torch.randn_like(hidden) @ self.differences.T)
        for number, (weight, bias) in enumerate(
            zip(self.weights[:-1], self.biases[:-1], strict=True)
        ):
            raw = F.gelu(torch.baddbmm(bias.view(self.members, 1, -1), hidden, weight))
            hidden = raw if number == 0 else (hidden + raw) * math.sqrt(0.5)
        return hidden


Array = npt.NDArray[np.float64]

RECIPE = Recipe(epochs=300, batch=128, learning_rate=3e-3, warmup=0.2, weight_decay=1e-2)
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
_HELD_OUT = 400
"""Most frames on which the form of a field is chosen."""
_PLACE = 2
"""Targets of a place: x and y."""
_SAME = 1e-6
"""Range of a target, in deviations, below which it never changes."""


class Pins(LearnedModel):
    """Regression of one answer from the displacements of all pins; no contact where they are small.

    A pin that was not seen stands where its neighbours say. The median is learned (the loss is the
    absolute error of the targets in standard deviations) by several networks, which differ in their
    first weights and in the noise that they are shown; the answer is their mean. Of channels the
    field is inverted that they follow.
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
        architecture = {
            "members": members,
            "width": width,
            "answer": context.answer,
            "transfers": context.transfers,
        }
        recipe = TRANSFER if context.transfers else RECIPE
        super().__init__(context, recipe.with_choices(epochs, precision), architecture)
        self._reader: Reader | None = None
        self._correction: Correction | None = None
        self._size, self._components = 2, 1
        self._varying: list[int] = []
        self._polar = False
        self._threshold = 0.0
        count = ANSWER_WIDTH[context.answer]
        self._scale = Normalisation(np.zeros(count), np.ones(count))

    def build(self) -> Members | Inversion:
        if isinstance(self._reader, Channels):
            return Inversion(self._size, self._varying, len(self._scale.mean), polar=self._polar)
        shape = self.architecture
        hidden = [shape["width"]] * _LAYERS
        sizes = [self._components, *hidden, len(self._scale.mean)]
        return Members(self._size, sizes, shape["members"])

    def usable_rows(self, truth: Sequence[Answer]) -> npt.NDArray[np.int64]:
        return regression_rows(truth, self.context.answer, self.name)

    def prepare(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:
        targets = known_targets(frames, truth, self.context.answer, self.name)
        self._scale = Normalisation.of(targets)
        self._reader = find_reader(frames, targets, self.context.transfers)
        self._size = self._reader.size
        most = _SHARED if self.context.transfers else _COMPONENTS
        self._components = min(most, self._size, max(1, len(frames) - 1))

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: tuple[Sequence[Frame], Sequence[Answer]],
        rng: np.random.Generator,
        progress: Progress,
    ) -> FitReport:
        """Train the networks, or learn the field of channels.

        Raises:
            UserError: There is no frame that the model can learn from, or the loss is not finite.
        """
        if not holds_channels(frames):
            return super().fit(frames, truth, validation=validation, rng=rng, progress=progress)
        began, count = time.perf_counter(), len(frames)
        frames, truth = self._usable(frames, truth)
        if len(frames) < FEWEST:
            raise UserError(
                f"model {self.name!r} was given {len(frames)} training frames with a contact, but "
                f"needs {FEWEST} to learn how channels depend on it; raise the training count."
            )
        self.prepare(frames, truth)
        moved = displacements(self._reader, frames, self.name)
        targets = self._scale.apply(self._vectors(truth))
        self._varying = np.flatnonzero(np.ptp(targets, axis=0) > _SAME).tolist()
        if not self._varying:
            raise UserError(
                "all training presses have one label, so that there is nothing to learn; import "
                "the columns that change."
            )
        self._threshold = contact_threshold(moved, self.context.answer)
        rows = np.sort(rng.permutation(len(moved))[:MOST])
        held_out, held_out_truth = self._usable(*validation)
        step = -(-len(held_out) // _HELD_OUT) or 1
        held_out, held_out_truth = held_out[::step], held_out_truth[::step]
        wanted = self._scale.apply(self._vectors(held_out_truth))
        found: list[tuple[float, nn.Module]] = []
        # Where only the place varies, so do the numbers of a vector; a size adds nothing.
        for as_polar in (False, True) if len(self._varying) > _PLACE else (False,):
            seen = polar(moved[rows]) if as_polar else moved[rows]
            forward = ForwardModel.fit(targets[rows][:, self._varying], seen)
            for shrinkage in SHRINKAGES if held_out else SHRINKAGES[:1]:
                self._polar = as_polar
                network = cast("Inversion", self._use(self.build()))
                network.tabulate(forward, shrinkage)
                answers = self._scale.apply(self.evaluate(held_out)[:, :-1]) if held_out else wanted
                found.append((float(np.abs(answers - wanted).sum()), network))
        best = cast("Inversion", min(found, key=lambda each: each[0])[1])
        self._polar = best.polar
        self._use(best)
        notes = {"without_contact": count - len(frames), "polar": best.polar}
        return FitReport(seconds=time.perf_counter() - began, notes=notes)

    def initialise(self, network: Members, training: Examples) -> None:
        moved = training.images.double().numpy()
        self._threshold = contact_threshold(moved, self.context.answer)
        assert self._reader is not None  # noqa: S101 - ``prepare`` came before
        components = Components.fit(moved, self._components)
        network.initialise(components, _WHITENING, self._reader.noise)
        if self.context.transfers:
            network.show_differences(Differences.on(LATTICE))

    def inputs(self, frames: Sequence[Frame]) -> torch.Tensor:
        return torch.from_numpy(displacements(self._reader, frames, self.name)).float()

    def targets(self, truth: Sequence[Answer]) -> torch.Tensor:
        targets = self._vectors(truth)
        return torch.from_numpy(self._scale.apply(targets)).float()

    def _vectors(self, truth: Sequence[Answer]) -> Array:
        force = len(self._scale.mean) > ANSWER_WIDTH[self.context.answer]
        return answer_vectors(truth, self.context.answer, self.name, force=force)

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

        Of channels the field itself is corrected. Frames that cannot be learned from are left out;
        where none is left, the answers are those of the trained model.

        Returns:
            Number of frames, and ridge of every target or what the field lacks, for the record.
        """
        self._correction = self._folded = None
        rows = self.usable_rows(truth)
        if not len(rows):
            return {"frames": 0}
        targets = self._scale.apply(self._vectors(truth)[rows])
        if isinstance(self.network, Inversion):
            moved = displacements(self._reader, [frames[row] for row in rows], self.name)
            folded, chosen = self.network.adapted(targets[:, self._varying], moved)
            self._folded = folded
            return {"frames": len(rows), **chosen}
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
            "varying": self._varying,
            "polar": self._polar,
            "scale": self._scale.to_json(),
            "least": self._threshold,
        }

    def restore(self, extra: dict[str, Any]) -> None:
        self._reader = restored_reader(extra)
        self._size = 2 if self._reader is None else self._reader.size
        self._components = extra["components"]
        self._varying, self._polar = extra["varying"], extra["polar"]
        self._scale = Normalisation.from_json(extra["scale"])
        self._threshold = extra["least"]
