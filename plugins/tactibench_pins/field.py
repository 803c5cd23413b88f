"""Channels of a skin as a smooth field over place, depth and force, and the field's inversion.

The channels c of a press depend smoothly on its targets y,

    c = f(y) + e,    e ~ N(0, S).

f is a Gaussian process: channels share lengths, and each has its own noise, because some hardly see
a press. S is the covariance of e_i = c_i - f_i(y_i), where f_i is learned without press i and
without the others at its place: it holds the errors of f between the places of the training, and
that a skin yields differently from press to press, which changes several channels together.

The answer is the mean of y for given c, where all y in the range of the training are equally
likely. f is tabulated on a lattice. Near a point g of it f(g + d) = f(g) + J d, so that d is normal
with

    mean H^-1 J' S^-1 (c - f(g)),    H = J' S^-1 J + P,

P the precision of d within a cell. The points whose fields are nearest to c are weighted by their
evidence.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any, Self

import numpy as np
import numpy.typing as npt
import torch
from scipy.linalg import cho_factor, cho_solve
from torch import nn

from tactibench.superposition import matern
from tactibench_pins.displacements import FAINT, polar

Array = npt.NDArray[np.float64]

MOST = 3500
"""Most presses that are learned from. The time grows with the third power of their number and is
seconds for this many."""
FEWEST = 10
"""Fewest presses of which a field is learned."""
_SAMPLE = 700
"""Most presses on which lengths and noise are chosen."""
_LENGTHS = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 4.0, 8.0)
"""Lengths of the kernel to try, in a target's deviation."""
_NOISES = tuple(10.0**power for power in range(-6, 1))
"""Variances of the noise to try, as shares of the variance of f."""
_ROUNDS = 2
"""Passes over the lengths, each tried at the best of the others."""
_ROWS = 1000
SHRINKAGES = (0.03, 0.01, 0.1, 0.3)
"""Shares to try by which the correlations of channels are taken as chance; the first one where no
frames are held out."""
_POINTS = {0: (), 1: (256,), 2: (64, 64), 3: (40, 40, 10), 4: (14, 14, 7, 7)}
"""Points of the lattice along each target, by their number: thousands in all."""
_NEAREST = 32
"""Points that are weighted; 64 answer alike."""
_LACKS = ((1.0, 2.0, 4.0), (0.0, 1.0, 10.0, 100.0), (0.0, 0.01, 0.1, 1.0), (1.0, 3.0, 10.0, 30.0))
"""Lengths and variances to try of what a field lacks in another session, see ``_lacking``; errors
of the first session have variance 1."""
_CELL = 0.4
"""Deviation of d, in cells. A uniform d has 0.3, but the nearest points need not be the best."""


@dataclass(frozen=True, eq=False)
class ForwardModel:
    """Gaussian process from T targets to C channels, with a Matern kernel of order 5/2.

    Attributes:
        targets: (N, T) targets of the presses, each divided by its length.
        lengths: (T,) lengths of the kernel.
        noise: (C,) variance of each channel's noise, as a share of that of f.
        alpha: (N, C) weights of the presses.
        mean: (C,) mean channels.
        residuals: (N, C) channels less those predicted from the presses at other places.
    """

    targets: Array
    lengths: Array
    noise: Array
    alpha: Array
    mean: Array
    residuals: Array

    @classmethod
    def fit(cls, targets: Array, moved: Array) -> Self:
        """Return the process that is fitted to presses.

        Args:
            targets: (N, T) targets; the first two are the place.
            moved: (N, C) channels.
        """
        mean = moved.mean(axis=0)
        centred, step = moved - mean, -(-len(moved) // _SAMPLE)
        lengths, noise = _choose_kernel(targets[::step], centred[::step])
        scaled = targets / lengths
        gram = matern(scaled, scaled, length=1.0)
        alpha, residuals = np.empty_like(centred), np.empty_like(centred)
        _, places = np.unique(targets[:, :2], axis=0, return_inverse=True)
        by_place = np.split(np.argsort(places, kind="stable"), np.cumsum(np.bincount(places))[:-1])
        for variance in np.unique(noise):
            own = np.flatnonzero(noise == variance)
            factor = cho_factor(gram + variance * np.eye(len(gram)), lower=True, overwrite_a=True)
            inverse = cho_solve(factor, np.eye(len(gram)), overwrite_b=True)
            weights = inverse @ centred[:, own]
            alpha[:, own] = weights
            for rows in by_place:
                # Rasmussen and Williams 2006, eq. 5.12, for several presses at once.
                missed = np.linalg.solve(inverse[np.ix_(rows, rows)], weights[rows])
                residuals[np.ix_(rows, own)] = missed
        return cls(scaled, lengths, noise, alpha, mean, residuals)

    def __call__(self, targets: Array) -> Array:
        """Return the channels (M, C) of targets (M, T)."""
        starts = range(0, len(targets), _ROWS)  # a kernel of all rows would fill the memory
        rows = (targets[start : start + _ROWS] / self.lengths for start in starts)
        fields = [matern(row, self.targets, length=1.0) @ self.alpha for row in rows]
        return np.asarray(np.concatenate(fields) + self.mean)

    @cached_property
    def table(self) -> tuple[Array, Array]:
        """Lattice (K, T) over the range of the presses, and the channels (K, C) there."""
        targets = self.targets * self.lengths
        counts = _POINTS[len(self.lengths)]
        ends = zip(targets.min(axis=0), targets.max(axis=0), counts, strict=True)
        axes = [np.linspace(low, high, count) for low, high, count in ends]
        places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
        return places, self(places)


def _choose_kernel(targets: Array, moved: Array) -> tuple[Array, Array]:
    """Return lengths (T,) and noise (C,) of the greatest marginal likelihood.

    Args:
        targets: (N, T) targets in deviations.
        moved: (N, C) channels less their mean.
    """
    lengths = np.ones(targets.shape[1])
    least, noise = _unlikelihood(targets, moved)
    for _, number, value in product(range(_ROUNDS), range(len(lengths)), _LENGTHS):
        candidate = lengths.copy()
        candidate[number] = value
        if value != lengths[number]:
            loss, of_channels = _unlikelihood(targets / candidate, moved)
            if loss < least:
                least, lengths, noise = loss, candidate, of_channels
    return lengths, noise


def _unlikelihood(targets: Array, moved: Array) -> tuple[float, Array]:
    """Return -2 log likelihood up to a constant, and the noise (C,) with which it is least.

    Every channel has the best variance of f (Rasmussen and Williams 2006, eq. 2.30).
    """
    values, vectors = np.linalg.eigh(matern(targets, targets, length=1.0))
    squares = np.square(vectors.T @ moved)
    losses = []
    for noise in _NOISES:
        spectrum = np.maximum(values, 0.0) + noise
        variance = np.maximum((squares / spectrum[:, None]).mean(axis=0), 1e-300)
        losses.append(len(moved) * np.log(variance) + np.log(spectrum).sum())
    best = np.argmin(losses, axis=0)
    return float(np.min(losses, axis=0).sum()), np.array(_NOISES)[best]


def _lacking(choice: Sequence[float], a: Array, b: Array, seen: Array, others: Array) -> Array:
    """Return the kernel (M, N) of what a field lacks at targets a (M, T) and b (N, T).

    Args:
        choice: Length, variance of the smooth part, variance of what is shared, noise.
        a: Targets.
        b: Targets.
        seen: (M, C) whitened channels at a.
        others: (N, C) whitened channels at b.
    """
    length, smooth, shared, _ = choice
    kernel = smooth * matern(a / length, b / length, length=1.0)
    return np.asarray(kernel + shared / seen.shape[1] * (seen @ others.T))


class Inversion(nn.Module):
    """From (B, C) channels to (B, 1, T + 1) normalised targets and rms of the channels.

    Args:
        channels: C.
        varying: Columns of the T targets that vary; the others are answered with 0.
        count: T.
        polar: Whether channels are taken as direction and size, see ``displacements.polar``: the
            direction hardly changes with depth or force, and the size tells it.
    """

    whitening: nn.Parameter
    places: nn.Parameter
    fields: nn.Parameter
    halves: nn.Parameter
    slopes: nn.Parameter
    precision: nn.Parameter

    def __init__(
        self, channels: int, varying: Sequence[int], count: int, *, polar: bool = False
    ) -> None:
        super().__init__()
        self.varying, self.count, self.polar = list(varying), count, polar
        channels += polar
        self.shape = _POINTS[len(self.varying)]
        points, axes = int(np.prod(self.shape)), len(self.shape)
        sizes = {
            "whitening": (channels, channels),
            "places": (points, axes),
            "fields": (points, channels),
            "halves": (points,),
            "slopes": (points, axes, channels),
            "precision": (axes,),
        }
        for name, size in sizes.items():
            setattr(self, name, nn.Parameter(torch.zeros(size), requires_grad=False))

    @torch.no_grad()
    def tabulate(self, forward: ForwardModel, shrinkage: float) -> None:
        """Take over a field of the varying targets.

        Args:
            forward: The field.
            shrinkage: Share by which the correlations of channels are taken as chance.
        """
        places, fields = forward.table
        covariance = np.cov(forward.residuals.T).reshape(len(forward.mean), -1)
        own = np.diag(covariance)
        shrunk = (1 - shrinkage) * covariance + np.diag(shrinkage * own + 1e-9 * own.mean() + 1e-12)
        whitening = np.linalg.inv(np.linalg.cholesky(shrunk)).T
        self._fill(places, fields @ whitening, whitening)

    def _fill(self, places: Array, fields: Array, whitening: Array) -> None:
        table = fields.reshape(*self.shape, -1)
        steps = (places[-1] - places[0]) / (np.array(self.shape) - 1)
        slopes = [np.gradient(table, step, axis=k) for k, step in enumerate(steps)]
        values = {
            "whitening": whitening,
            "places": places,
            "fields": fields,
            "halves": 0.5 * np.square(fields).sum(axis=1),
            "slopes": np.stack([slope.reshape(fields.shape) for slope in slopes], axis=1),
            "precision": (_CELL * steps) ** -2.0,
        }
        for name, value in values.items():
            getattr(self, name).copy_(torch.from_numpy(value))

    @torch.no_grad()
    def adapted(self, targets: Array, moved: Array) -> tuple[Self, dict[str, Any]]:
        """Return the inversion of another session's or sensor's field, and what was chosen for it.

        What the field lacks there is a process of its own: smooth over the targets, and with a
        share of what other channels show. Its kernel has the greatest marginal likelihood.

        Args:
            targets: (n, T) normalised targets of labelled presses, those that vary.
            moved: (n, C) their channels.
        """
        arrays = (self.places, self.fields, self.slopes, self.whitening)
        places, fields, slopes, whitening = (each.double().cpu().numpy() for each in arrays)
        near = np.square(targets[:, None] - places).sum(axis=2).argmin(axis=1)
        away = targets - places[near]
        expected = fields[near] + np.einsum("nt,ntc->nc", away, slopes[near])
        missed = (polar(moved) if self.polar else moved) @ whitening - expected
        best = (np.inf, (0.0,) * 4)
        for choice in product(*_LACKS):
            values, vectors = np.linalg.eigh(_lacking(choice, targets, targets, expected, expected))
            spectrum = np.maximum(values, 0.0) + choice[-1]
            loss = (np.square(vectors.T @ missed) / spectrum[:, None]).sum()
            best = min(best, (loss + missed.shape[1] * np.log(spectrum).sum(), choice))
        choice = best[1]
        gram = _lacking(choice, targets, targets, expected, expected)
        inverse = np.linalg.inv(gram + choice[-1] * np.eye(len(gram)))
        alpha = inverse @ missed
        spread = np.sqrt(np.square(alpha / np.diag(inverse)[:, None]).mean(axis=0))
        moved_fields = fields + _lacking(choice, places, targets, fields, expected) @ alpha
        other = copy.deepcopy(self)
        other._fill(places, moved_fields / spread, whitening / spread)
        names = ("length", "smooth", "shared", "noise")
        return other, dict(zip(names, choice, strict=True))

    def forward(self, moved: torch.Tensor) -> torch.Tensor:
        """Return the answers to channels."""
        rms = moved.square().mean(dim=1, keepdim=True).sqrt()
        seen = moved
        if self.polar:
            size = rms.clamp_min(FAINT)
            seen = torch.cat([moved / size, 2 * size.log()], dim=1)
        seen = seen @ self.whitening
        unlike = self.halves - seen @ self.fields.T  # half the square of the distance
        rows = unlike.topk(_NEAREST, dim=1, largest=False).indices
        missed = seen[:, None] - self.fields[rows]
        slopes = self.slopes[rows]
        slope = (slopes @ missed[..., None])[..., 0]
        bend = slopes @ slopes.transpose(-1, -2) + torch.diag(self.precision)
        step = torch.linalg.solve(bend, slope)
        loss = missed.square().sum(dim=-1) - (slope * step).sum(dim=-1) + torch.logdet(bend)
        weights = torch.softmax(-0.5 * loss, dim=1)
        values = moved.new_zeros(len(moved), self.count)
        values[:, self.varying] = (weights[..., None] * (self.places[rows] + step)).sum(dim=1)
        return torch.cat([values, rms], dim=1)[:, None]
