"""Assignment of predictions to true contacts.

The assignment minimises the sum over true-predicted pairs of min(distance, gate)^p with p = 1, in
two dimensions, and pairs at or beyond the gate are then dissolved. That is the assignment inside
GOSPA with alpha = 2 (Rahmathullah, Garcia-Fernandez and Svensson 2017): two contacts that are
paired cost their distance, and two that are left alone cost the gate. It does not seek the largest
number of pairs: one pair at 0.1 mm is preferred to two at 2.9 mm, where the gate is 3 mm. With an
infinite gate it is the plain minimum-cost assignment.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from tactibench.contacts import Contacts
from tactibench.stats import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Pairs:
    """Matched contacts of all trials, ordered by trial and then by true contact.

    Attributes:
        trial: (P,) index of the trial.
        truth: (P,) index of the true contact inside the trial.
        prediction: (P,) index of the predicted contact inside the trial.
        true_xy: (P, 2) mm.
        predicted_xy: (P, 2) mm.
        true_depth: (P,) mm.
        predicted_depth: (P,) mm.
        distance: (P,) distance of the two contacts in the plane, mm.
    """

    trial: IntArray
    truth: IntArray
    prediction: IntArray
    true_xy: FloatArray
    predicted_xy: FloatArray
    true_depth: FloatArray
    predicted_depth: FloatArray
    distance: FloatArray

    def per_trial(self, trials: int) -> IntArray:
        """Return the (N,) number of pairs in each trial."""
        return np.bincount(self.trial, minlength=trials)


def match(
    truth: FloatArray, predicted: FloatArray, gate: float, power: int = 1
) -> tuple[IntArray, IntArray, FloatArray]:
    """Match true to predicted points.

    Args:
        truth: (K, 2) mm.
        predicted: (M, 2) mm.
        gate: Distance from which on two points are no pair, mm; inf for none.
        power: Exponent of the cost of a pair.

    Returns:
        (P,) indices of the true points that are paired, (P,) indices of their partners, and (P,)
        distances, mm.
    """
    if not len(truth) or not len(predicted):
        none = np.empty(0, dtype=np.intp)
        return none, none, np.empty(0)
    x, y = (np.subtract.outer(truth[:, axis], predicted[:, axis]) for axis in (0, 1))
    distance = np.hypot(x, y)
    if distance.size == 1:
        rows = columns = np.zeros(1, dtype=np.intp)
    else:
        cost = np.minimum(distance, gate)
        rows, columns = linear_sum_assignment(cost if power == 1 else cost**power)
    chosen = distance[rows, columns]
    inside = chosen < gate
    if inside.all():
        return rows, columns, chosen
    return rows[inside], columns[inside], chosen[inside]


def match_trials(truth: Sequence[Contacts], predictions: Sequence[Contacts], gate: float) -> Pairs:
    """Return the pairs of all trials in one table.

    Args:
        truth: True contacts of every trial.
        predictions: Predicted contacts of every trial.
        gate: Distance from which on two contacts are no pair, mm; inf for none.
    """
    matches = [match(t.xy, p.xy, gate) for t, p in zip(truth, predictions, strict=True)]
    rows = _join([f[0] for f in matches]).astype(np.intp)
    columns = _join([f[1] for f in matches]).astype(np.intp)
    sizes = np.array([len(f[0]) for f in matches], dtype=np.intp)
    trial = np.repeat(np.arange(len(matches)), sizes)
    at_truth = _starts(truth)[trial] + rows
    at_prediction = _starts(predictions)[trial] + columns
    return Pairs(
        trial,
        rows,
        columns,
        _stack([c.xy for c in truth])[at_truth],
        _stack([c.xy for c in predictions])[at_prediction],
        _join([c.depth for c in truth])[at_truth],
        _join([c.depth for c in predictions])[at_prediction],
        _join([f[2] for f in matches]),
    )


def runs(trial: IntArray) -> Iterator[tuple[int, slice]]:
    """Yield each trial that occurs in a sorted index of trials, with the slice of its rows."""
    unique, starts, sizes = np.unique(trial, return_index=True, return_counts=True)
    for number, start, size in zip(unique, starts, sizes, strict=True):
        yield int(number), slice(int(start), int(start + size))


def _starts(contacts: Sequence[Contacts]) -> IntArray:
    sizes = np.array([len(c) for c in contacts], dtype=np.intp)
    return np.cumsum(sizes) - sizes


def _join(parts: Sequence[npt.NDArray[Any]]) -> FloatArray:
    return np.concatenate(parts) if len(parts) else np.empty(0)


def _stack(parts: Sequence[FloatArray]) -> FloatArray:
    return np.concatenate(parts) if len(parts) else np.empty((0, 2))
