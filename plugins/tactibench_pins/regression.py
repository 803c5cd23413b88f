"""Kernel regression of the median: a radial kernel, ridge, and weights that forgive outliers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

from tactibench_pins.displacements import Components

Array = npt.NDArray[np.float64]

_SMALLEST = 0.02
"""Residuals below this share of a target's deviation weigh alike."""


@dataclass(frozen=True)
class Setting:
    """Choices of a kernel regression.

    Attributes:
        components: of the displacements.
        whitening: of their spreads (see ``Components``).
        length: of the kernel, in rms distances of a frame from the mean one.
        ridge: on the kernel's diagonal.
        rounds: of reweighting; 0: least squares.
    """

    components: int = 40
    whitening: float = 0.5
    length: float = 1.0
    ridge: float = 1e-3
    rounds: int = 2


CHOICES: Mapping[str, tuple[Any, ...]] = {
    "ridge": (1e-3, 1e-2, 3e-2, 1e-1),
    "components": (20, 40, 60),
    "length": (0.7, 1.0, 1.5),
    "whitening": (0.25, 0.5),
}
"""Values to try, in this order, each at the best of those tried before."""
MOST = max(CHOICES["components"])


@dataclass(frozen=True, eq=False)
class Features:
    """Displacements (N, 2 P) that are learned from, and normalised targets (N, T)."""

    components: Components
    moved: Array
    targets: Array

    def places(self, setting: Setting, moved: Array | None = None) -> tuple[Array, float]:
        """Return (M, K) components of displacements (by default its own), and a kernel length."""
        some = self.components.first(setting.components)
        own = some.of(self.moved, setting.whitening)
        length = setting.length * float(np.sqrt(np.square(own).sum(axis=1).mean()))
        return (own if moved is None else some.of(moved, setting.whitening)), max(length, 1e-9)


def choose_setting(learned: Features, held_out: Array, targets: Array) -> Setting:
    """Return the setting with the least mean absolute error of frames that were held out.

    Args:
        learned: the frames that are learned from.
        held_out: (M, 2 P) displacements.
        targets: (M, T) normalised targets of these.
    """
    best = Setting()
    least = _error(learned, held_out, targets, best)
    for name, values in CHOICES.items():
        for value in values:
            candidate = replace(best, **{name: value})
            if value == getattr(best, name):
                continue
            error = _error(learned, held_out, targets, candidate)
            if error < least:
                least, best = error, candidate
    return best


def _error(learned: Features, held_out: Array, targets: Array, setting: Setting) -> float:
    own, length = learned.places(setting)
    alpha = kernel_weights(kernel(own, own, length), learned.targets, setting)
    places, _ = learned.places(setting, held_out)
    return float(np.abs(kernel(places, own, length) @ alpha - targets).mean())


def kernel(a: Array, b: Array, length: float) -> Array:
    """Return (N, M) exp(-|a - b|^2 / (2 l^2)) of features (N, K) and (M, K)."""
    squares = cdist(a, b, "sqeuclidean")
    squares *= -0.5 / length**2
    return np.asarray(np.exp(squares, out=squares))


def kernel_weights(gram: Array, targets: Array, setting: Setting) -> Array:
    """Return (N, T) alpha with f(x) = sum_i k(x, x_i) alpha_i.

    Least squares: (K + ridge I) alpha = y. A round of reweighting puts ridge |r_i| / mean |r| in
    the place of ridge, r the residuals so far, which drives towards the least absolute residuals
    (iteratively reweighted least squares; Holland and Welsch 1977).

    Args:
        gram: (N, N) k(x_i, x_j).
        targets: (N, T).
        setting: its ridge and rounds.
    """
    count = len(gram)
    plain = cho_solve(cho_factor(_loaded(gram, np.full(count, setting.ridge))), targets)
    columns = []
    for alpha, target in zip(plain.T, targets.T, strict=True):
        for _ in range(setting.rounds):
            residual = np.maximum(np.abs(target - gram @ alpha), _SMALLEST)
            load = setting.ridge * residual / residual.mean()
            alpha = cho_solve(cho_factor(_loaded(gram, load)), target)
        columns.append(alpha)
    return np.stack(columns, axis=1)


def _loaded(gram: Array, load: Array) -> Array:
    loaded = gram.copy()
    loaded[np.diag_indices(len(gram))] += load
    return loaded
