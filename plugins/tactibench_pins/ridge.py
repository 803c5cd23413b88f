"""Kernel regression of the median: a radial kernel, ridge, and weights that forgive outliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

Array = npt.NDArray[np.float64]

_SMALLEST = 0.02
"""Residuals below this share of a target's deviation weigh alike."""


@dataclass(frozen=True)
class Setting:
    """components: of the displacements. whitening: of their spreads (see ``Components``). length:
    of the kernel, in rms distances of a frame from the mean one. ridge: on the kernel's diagonal.
    rounds: of reweighting; 0: least squares."""

    components: int = 40
    whitening: float = 0.5
    length: float = 1.0
    ridge: float = 1e-3
    rounds: int = 2


def kernel(a: Array, b: Array, length: float) -> Array:
    """(N, M) exp(-|a - b|^2 / (2 l^2)) of features (N, K) and (M, K)."""
    squares = cdist(a, b, "sqeuclidean")
    squares *= -0.5 / length**2
    return np.exp(squares, out=squares)


def weights(gram: Array, targets: Array, setting: Setting) -> Array:
    """(N, T) alpha with f(x) = sum_i k(x, x_i) alpha_i, from (N, N) k(x_i, x_j) and (N, T) targets.

    Least squares: (K + ridge I) alpha = y. A round of reweighting puts ridge |r_i| / mean |r| in
    the place of ridge, r the residuals so far, which drives towards the least absolute residuals
    (iteratively reweighted least squares; Holland and Welsch 1977).
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
