"""How much larger or smaller than stated a model's errors are, from frames it was not fitted to."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tactibench import Contacts

Array = npt.NDArray[np.float64]

_FEWEST = 20
"""Contacts from which a 95 % quantile is read; with fewer the stated std stays as it is."""
_AXIS_95 = 1.959964
_PLANE_95 = math.sqrt(-2 * math.log(0.05))


def std_factors(found: Sequence[Contacts], truth: Sequence[Contacts]) -> Array:
    """(2, 3) factors for the std of x, y and depth: of contacts alone in a frame, and of others.

    With them 95 % of the errors lie inside the 95 % ellipse in the plane and the 95 % interval of
    depth. Frames in which the number of contacts was found are used. Where there are too few with
    several contacts, the factors of single ones serve for both.
    """
    pairs = [pair for pair in zip(found, truth, strict=True) if len(pair[0]) == len(pair[1])]
    alone = _factors([pair for pair in pairs if len(pair[0]) == 1], np.ones(3))
    return np.stack([alone, _factors([pair for pair in pairs if len(pair[0]) > 1], alone)])


def _factors(pairs: Sequence[tuple[Contacts, Contacts]], otherwise: Array) -> Array:
    z = np.concatenate([np.empty((0, 3)), *(_standardised(*pair) for pair in pairs)])
    if len(z) < _FEWEST:
        return otherwise
    axes = np.maximum(np.quantile(np.abs(z), 0.95, axis=0) / _AXIS_95, 1e-3)
    plane = np.quantile(np.hypot(*(z[:, :2] / axes[:2]).T), 0.95) / _PLANE_95
    factors: Array = axes * [plane, plane, 1.0]
    return factors


def _standardised(found: Contacts, truth: Contacts) -> Array:
    """(K, 3) error / std of every true contact's nearest answer; none without a std."""
    if found.std is None:
        return np.empty((0, 3))
    away = np.linalg.norm(found.xy[:, None] - truth.xy, axis=-1)
    nearest = away.argmin(axis=0)
    error = np.column_stack([found.xy, found.depth])[nearest] - np.column_stack(
        [truth.xy, truth.depth]
    )
    return np.asarray(error / found.std[nearest], dtype=np.float64)
