"""The model ``pins``: frames -> displacements of the pins -> averaged networks -> one answer.

Several dense networks in one: all members take a batch in one product a layer.

Further training presses of a sensor of channels, made from the presses that there are.

A skin is pressed at few places, and its channels depend smoothly on place and depth. A Gaussian
process learns this dependence f from the training presses. Press i is then moved from its targets
y_i to others nearby,

    c = f(y) + e_i,    e_i = c_i - f_i(y_i),

where f_i is learned without press i and without the others at its place. So the networks see places
between those of the training, with the errors of real presses: the skin yields differently from
press to press, which changes several channels together. Noise of every channel alone leaves that
out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Any, Self, cast

import numpy as np
import numpy.typing as npt
import torch
from scipy.linalg import cho_factor, cho_solve
from torch import nn
from torch.nn import functional as F  # noqa: N812

from tactibench import Answer, Frame, ModelContext, Stage
from tactibench.superposition import matern
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
    FAINT,
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
    read_answers,
    restored_reader,
)

_LAST = 0.1
"""Factor on the usual size of the last layer's first weights, so that answers start near the
mean."""


def torch_polar(moved: torch.Tensor) -> torch.Tensor:
    """Return ``polar`` of a tensor (..., C)."""
    size = moved.square().mean(dim=-1, keepdim=True).sqrt().clamp_min(FAINT)
    return torch.cat([moved / size, 2 * size.log()], dim=-1)


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

    def __init__(self, size: int, sizes: Sequence[int], members: int, polar: bool = False) -> None:
        """Make ``members`` networks.

        Args:
            size: Numbers of a frame, 2 P.
            sizes: K, units of the hidden layers, T.
            members: M.
            polar: Whether vectors are taken as direction and size.
        """
        super().__init__()
        self.members = members
        self.polar = polar
        self.channel_noise = 0.0
        size += polar
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
        if self.polar:  # channels are noisy, not their directions
            self.channel_noise = noise
        else:
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
        if self.polar:
            vectors = moved.expand(self.members, -1, -1)
            if self.training:
                vectors = vectors + self.channel_noise * torch.randn_like(vectors)
            hidden = (torch_polar(vectors) - self.mean) @ self.basis
        else:
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

COPIES = 8
"""Moved presses for each press. With 16 the training takes twice as long, and the error on a fifth
of the training places of eFlesh is 3 % less."""
REACH = 0.5
"""Most that a press is moved along each target, in the target's deviation over the presses.
A quarter, or any place of the range, is worse on a fifth of the training places of eFlesh; 0.8 is
as good."""
_MOST = 4000
"""Most presses that are learned from. The time grows with the third power of their number and is
seconds for this many."""
_SAMPLE = 1600
"""Most presses on which lengths and noise are chosen; fewer lie farther apart and favour more
noise."""
_LENGTHS = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 4.0, 8.0)
"""Lengths of the kernel to try, in a target's deviation."""
_NOISES = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 1e-1)
"""Variances of the noise to try, as shares of the variance of f."""
_ROUNDS = 2
"""Passes over lengths and noise, each tried at the best of the others."""
_KERNEL_ROWS = 1000


@dataclass(frozen=True, eq=False)
class ForwardModel:
    """Gaussian process from T targets to C channels, with a Matern kernel of order 5/2.

    Attributes:
        targets: (N, T) targets of the presses, each divided by its length.
        lengths: (T,) lengths of the kernel.
        alpha: (N, C) weights of the presses.
        mean: (C,) mean channels.
        residuals: (N, C) channels less those predicted from the presses at other places.
    """

    targets: Array
    lengths: Array
    alpha: Array
    mean: Array
    residuals: Array

    @classmethod
    def fit(cls, targets: Array, moved: Array, places: npt.NDArray[np.intp]) -> Self:
        """Return the process that is fitted to presses.

        Args:
            targets: (N, T) targets.
            moved: (N, C) channels.
            places: (N,) number of the place of every press.
        """
        mean = moved.mean(axis=0)
        step = -(-len(moved) // _SAMPLE)
        lengths, noise = _choose_kernel(targets[::step], (moved - mean)[::step])
        scaled = targets / lengths
        inverse = cho_solve(_factor(scaled, noise), np.eye(len(scaled)))
        alpha = inverse @ (moved - mean)
        residuals = np.empty_like(moved)
        for place in np.unique(places):
            # Rasmussen and Williams 2006, eq. 5.12, for several presses at once.
            rows = np.flatnonzero(places == place)
            residuals[rows] = np.linalg.solve(inverse[np.ix_(rows, rows)], alpha[rows])
        return cls(scaled, lengths, alpha, mean, residuals)

    def __call__(self, targets: Array) -> Array:
        """Return the channels (M, C) of targets (M, T)."""
        starts = range(0, len(targets), _KERNEL_ROWS)  # a kernel of all rows would fill the memory
        rows = (targets[start : start + _KERNEL_ROWS] / self.lengths for start in starts)
        return (
            np.concatenate([matern(row, self.targets, length=1.0) @ self.alpha for row in rows])
            + self.mean
        )


def move_presses(targets: Array, moved: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return targets and channels of COPIES moved presses for each one.

    Args:
        targets: (N, T) targets in deviations; a moved press stays within their range.
        moved: (N, C) channels.
        rng: Generator that draws the moves.
    """
    if len(targets) > _MOST:
        rows = np.sort(rng.permutation(len(targets))[:_MOST])
        targets, moved = targets[rows], moved[rows]
    # The first two targets of a contact are its place; presses of one place err alike. A plate has
    # no further targets, so that each of its presses is left out alone.
    _, places = np.unique(targets[:, :2], axis=0, return_inverse=True)
    forward = ForwardModel.fit(targets, moved, places.reshape(-1))
    low, high = targets.min(axis=0), targets.max(axis=0)
    new_targets, new_moved = [], []
    for _ in range(COPIES):
        nearby = targets + rng.uniform(-REACH, REACH, targets.shape)
        nearby = np.where(nearby < low, 2 * low - nearby, nearby)
        nearby = np.where(nearby > high, 2 * high - nearby, nearby).clip(low, high)
        new_targets.append(nearby)
        new_moved.append(forward(nearby) + forward.residuals)
    return np.concatenate(new_targets), np.concatenate(new_moved)


def _choose_kernel(targets: Array, moved: Array) -> tuple[Array, float]:
    """Return lengths (T,) and noise of the greatest marginal likelihood.

    Args:
        targets: (N, T) targets in deviations.
        moved: (N, C) channels less their mean.
    """
    count = targets.shape[1]
    lengths = [_LENGTHS if np.ptp(column) > 0 else (1.0,) for column in targets.T]
    choices = [*lengths, _NOISES]
    best = np.array([1.0] * count + [1e-3])
    least = np.inf
    for _, (number, values) in product(range(_ROUNDS), enumerate(choices)):
        for value in values:
            candidate = best.copy()
            candidate[number] = value
            loss = _unlikelihood(targets / candidate[:-1], moved, candidate[-1])
            if loss < least:
                least, best = loss, candidate
    return best[:-1], float(best[-1])


def _unlikelihood(targets: Array, moved: Array, noise: float) -> float:
    """Return -2 / C times the log likelihood with the best variance of f, up to a constant.

    Rasmussen and Williams 2006, eq. 2.30, for C channels of one kernel.
    """
    factor = _factor(targets, noise)
    variance = float(np.mean(moved * cho_solve(factor, moved)))
    determinant = 2.0 * float(np.log(np.diag(factor[0])).sum())
    return len(moved) * math.log(max(variance, 1e-300)) + determinant


def _factor(targets: Array, noise: float) -> tuple[Array, bool]:
    gram = matern(targets, targets, length=1.0)
    gram[np.diag_indices(len(gram))] += noise
    factor: tuple[Array, bool] = cho_factor(gram, lower=True, overwrite_a=True)
    return factor


RECIPE = Recipe(epochs=300, batch=128, learning_rate=3e-3, warmup=0.2, weight_decay=1e-2)
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
        architecture = {
            "members": members,
            "width": width,
            "answer": context.answer,
            "transfers": context.transfers,
        }
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
        sizes = [self._components, *hidden, len(self._scale.mean)]
        return Members(
            self._size, sizes, shape["members"], self._reader is not None and self._reader.polar
        )

    def usable_rows(self, truth: Sequence[Answer]) -> npt.NDArray[np.int64]:
        return regression_rows(truth, self.context.answer, self.name)

    def prepare(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:
        targets = known_targets(frames, truth, self.context.answer, self.name)
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

        Frames that cannot be learned from are left out; where none is left, the answers are those
        of the trained model.

        Returns:
            Number of frames and ridge of every target, for the record.
        """
        self._correction = None
        rows = self.usable_rows(truth)
        if not len(rows):
            return {"frames": 0}
        targets = self._scale.apply(self._vectors(truth)[rows])
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
        self._reader = restored_reader(extra)
        self._size = 2 if self._reader is None else self._reader.size
        self._components = extra["components"]
        self._scale = Normalisation.from_json(extra["scale"])
        self._threshold = extra["least"]
