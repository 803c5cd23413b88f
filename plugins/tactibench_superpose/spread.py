"""How far off the answers are: what noise leaves open, and what the neighbour law does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_FLOOR_MM = 0.05
_NORMAL_95 = 1.96


@dataclass(frozen=True, eq=False)
class Spread:
    """noise: (3,) factor on the deviations of the fit, x, y, depth.

    law: (2, 3) error of the neighbour law by mm of shift (plus 0.05), of two contacts and of more.
    """

    noise: Array
    law: Array

    def std(self, normal: Array, chi2: float, freedom: int, shift: Array) -> Array:
        """(K, 3) mm. normal: (3 K, 3 K) of the fit, chi2 with its degrees of freedom.

        shift: (K, 3) mm from equivalents to contacts.
        """
        count = len(shift)
        inverse = np.linalg.pinv(normal, hermitian=True)
        excess = max(1.0, chi2 / max(freedom, 1)) if count == 1 else 1.0
        variance = np.diagonal(inverse).reshape(count, 3) * excess * self.noise**2
        if count > 1:
            way = np.linalg.norm(shift, axis=1, keepdims=True) + _FLOOR_MM
            variance = variance + (self.law[min(count, 3) - 2] * way) ** 2
        out: Array = np.sqrt(variance).clip(1e-4)
        return out


def law_errors(shift: Array, error: Array) -> Array:
    """(3,) of ``Spread.law`` from shifts and errors (S, K, 3): 95 % of them lie within 1.96."""
    way = np.linalg.norm(shift, axis=-1, keepdims=True) + _FLOOR_MM
    ratio = np.quantile(np.abs(error) / way, 0.95, axis=(0, 1)) / _NORMAL_95
    ratio[:2] = ratio[:2].mean()
    return np.asarray(ratio, dtype=np.float64)


def noise_factors(error: Array, std: Array) -> Array:
    """(3,): 95 % of the errors (N, 3) shall lie within 1.96 deviations (N, 3)."""
    if not len(error):
        return np.ones(3)
    return np.asarray(np.quantile(np.abs(error) / std, 0.95, axis=0) / _NORMAL_95)
