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
"""Residuals below this share of a target's deviation have equal weights."""


@dataclass(frozen=True)
class Setting:
    """Choices of a kernel regression.

    Attributes:
        components: Number of components of the displacements.
        whitening: Power of the components' spreads, see ``Components.weights``.
        length: Length of the kernel, in rms distances of a frame from the mean frame.
        ridge: Ridge on the kernel's diagonal.
        rounds: Rounds of reweighting; 0: least squares.
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
"""Values to try, in this order, each with the best values so far."""
MOST = max(CHOICES["components"])


@dataclass(frozen=True, eq=False)
class Features:
    """The training frames of a kernel regression.

    Attributes:
        components: Components of the displacements.
        moved: (N, 2 P) displacements.
        targets: (N, T) normalised targets.
    """

    components: Components
    moved: Array
    targets: Array

    def places(self, setting: Setting, moved: Array | None = None) -> tuple[Array, float]:
        """Return the components (M, K) of displacements, and the length of the kernel.

        Args:
            setting: Choices of the regression.
            moved: (M, 2 P) displacements; None: those of the training frames.
        """
        first = self.components.first(setting.components)
        trained = first.of(self.moved, setting.whitening)
        length = setting.length * float(np.sqrt(np.square(trained).sum(axis=1).mean()))
        return (trained if moved is None else first.of(moved, setting.whitening)), max(length, 1e-9)


def choose_setting(learned: Features, held_out: Array, targets: Array) -> Setting:
    """Return the setting with the least mean absolute error of frames that were held out.

    Args:
        learned: The frames that are learned from.
        held_out: (M, 2 P) displacements of the frames that were held out.
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
    trained, length = learned.places(setting)
    alpha = kernel_weights(kernel(trained, trained, length), learned.targets, setting)
    places, _ = learned.places(setting, held_out)
    return float(np.abs(kernel(places, trained, length) @ alpha - targets).mean())


def kernel(a: Array, b: Array, length: float) -> Array:
    """Return exp(-|a - b|^2 / (2 length^2)), (N, M), of features a (N, K) and b (M, K)."""
    squares = cdist(a, b, "sqeuclidean")
    squares *= -0.5 / length**2
    return np.asarray(np.exp(squares, out=squares))


def kernel_weights(gram: Array, targets: Array, setting: Setting) -> Array:
    """Return the weights alpha (N, T) of f(x) = sum_i k(x, x_i) alpha_i.

    Least squares: (K + ridge I) alpha = y. A round of reweighting replaces ridge by
    ridge |r_i| / mean |r|, with the residuals r so far, which leads towards the least absolute
    residuals (iteratively reweighted least squares; Holland and Welsch 1977).

    Args:
        gram: (N, N) k(x_i, x_j).
        targets: (N, T) y.
        setting: Choices of the regression, of which ridge and rounds are used.
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
