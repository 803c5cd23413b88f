"""Cluster labels, and the check that keeps NaN out of every statistic."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]
Labels = npt.NDArray[Any]


def finite(values: npt.ArrayLike, name: str) -> FloatArray:
    """Return the values as float64. Raises ValueError, with the count, if any is not finite."""
    array = np.asarray(values, dtype=np.float64)
    bad = int(array.size - np.isfinite(array).sum())
    if bad:
        raise ValueError(f"{name}: {bad} of {array.size} values are not finite")
    return array


def cluster_codes(labels: npt.ArrayLike, n: int) -> tuple[IntArray, int]:
    """Number the labels of n values: (n,) codes 0..G-1 and G."""
    array = np.asarray(labels)
    if array.shape != (n,):
        raise ValueError(f"{n} values have cluster labels of shape {array.shape}")
    unique, codes = np.unique(array, return_inverse=True)
    return codes.reshape(-1), len(unique)


def cluster_sums(values: FloatArray, codes: IntArray, count: int) -> FloatArray:
    """Sum (n,) or (n, K) values over each cluster: (G,) or (G, K)."""
    if values.ndim == 1:
        return np.bincount(codes, values, count).astype(np.float64)
    return np.stack([np.bincount(codes, column, count) for column in values.T], axis=1)
