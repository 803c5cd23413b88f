"""How much larger or smaller than stated a model's errors are, from frames it was not fitted to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]

_HELD_BACK = 20
"""Every so many frames with several contacts are kept from a training."""
_FEWEST = 20
"""Contacts from which a 95 % quantile is read; with fewer the stated std stays as it is."""
_AXIS_95 = 1.959964
_PLANE_95 = math.sqrt(-2 * math.log(0.05))


def held_back(truth: Sequence[Answer]) -> tuple[Rows, Rows]:
    """Rows to learn from, and those with several contacts that are kept for ``std_factors``.

    The validation frames of a protocol hold single contacts, whose errors are of another size.
    """
    several = [isinstance(answer, Contacts) and len(answer) > 1 for answer in truth]
    kept = np.flatnonzero(several)[_HELD_BACK - 1 :: _HELD_BACK]
    return np.setdiff1d(np.arange(len(truth)), kept), kept


def std_factors(found: Sequence[Contacts], truth: Sequence[Contacts]) -> Array:
    """(2, 3) factors for the std of x, y and depth: of contacts alone in a frame, and of others.

    With them 95 % of the errors lie inside the 95 % ellipse in the plane and the 95 % interval of
    depth. Frames in which the number of contacts was found are used. Where there are too few with
    several contacts, the factors of single ones serve for both.
    """
    pairs = [pair for pair in zip(found, truth, strict=True) if len(pair[0]) == len(pair[1])]
    alone = _factors([pair for pair in pairs if len(pair[0]) == 1], np.ones(3))
    return np.stack([alone, _factors([pair for pair in pairs if len(pair[0]) > 1], alone)])


def scale_std(contacts: Contacts, factors: Array) -> Contacts:
    """The contacts with their std, where they have one, times the factors of ``std_factors``."""
    if contacts.std is None:
        return contacts
    return replace(contacts, std=contacts.std * factors[int(len(contacts) > 1)])


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
