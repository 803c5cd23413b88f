"""Cluster labels, and the check that keeps NaN out of every statistic."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]
Labels = npt.NDArray[Any]


def finite(values: npt.ArrayLike, name: str) -> FloatArray:
    """Return the values as float64.

    Args:
        values: Any shape.
        name: Name of the values, for the error.

    Raises:
        ValueError: A value is not finite. The message counts such values.
    """
    array = np.asarray(values, dtype=np.float64)
    bad = int(array.size - np.isfinite(array).sum())
    if bad:
        raise ValueError(f"{name}: {bad} of {array.size} values are not finite")
    return array


def cluster_codes(labels: npt.ArrayLike, n: int) -> tuple[IntArray, int]:
    """Return (n,) codes 0..G - 1 of the labels of n values, and the number of clusters G.

    Raises:
        ValueError: There is not one label for each value.
    """
    array = np.asarray(labels)
    if array.shape != (n,):
        raise ValueError(f"{n} values have cluster labels of shape {array.shape}")
    unique, codes = np.unique(array, return_inverse=True)
    return codes.reshape(-1), len(unique)


def cluster_sums(values: FloatArray, codes: IntArray, count: int) -> FloatArray:
    """Return the sums over each cluster, (G,) or (G, K), of (n,) or (n, K) values.

    Args:
        values: (n,) or (n, K).
        codes: (n,) number of each value's cluster, 0..G - 1.
        count: Number of clusters G.
    """
    if values.ndim == 1:
        return np.bincount(codes, values, count).astype(np.float64)
    return np.stack([np.bincount(codes, column, count) for column in values.T], axis=1)
