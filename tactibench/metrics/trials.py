"""Truth, predictions and their pairs of every test frame: all that a metric is computed from.

The assignment of predictions to true contacts minimises the sum over true-predicted pairs of
min(distance, gate)^p with p = 1, in two dimensions, and pairs at or beyond the gate are then
dissolved. That is the assignment inside GOSPA with alpha = 2 (Rahmathullah, Garcia-Fernandez and
Svensson 2017): two contacts that are paired cost their distance, and two that are left alone cost
the gate. It does not seek the largest number of pairs: one pair at 0.1 mm is preferred to two at
2.9 mm, where the gate is 3 mm. With an infinite gate it is the plain minimum-cost assignment.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, reduce
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from tactibench.contacts import Contacts, PlatePose
from tactibench.protocols import Axis
from tactibench.stats import FloatArray, IntArray, Labels


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

    @property
    def error(self) -> FloatArray:
        """The (P, 3) errors of x, y and depth, mm."""
        apart = self.predicted_depth - self.true_depth
        return np.column_stack([self.predicted_xy - self.true_xy, apart])

    def per_trial(self, trials: int) -> IntArray:
        """Return the (N,) number of pairs in each trial."""
        return np.bincount(self.trial, minlength=trials)


def match(
    truth: FloatArray, predicted: FloatArray, gate: float, power: int = 1
) -> tuple[IntArray, IntArray, FloatArray]:
    """Match true to predicted points.

    Args:
        truth: (K, D) places of D axes, mm.
        predicted: (M, D) mm.
        gate: Distance from which on two points are no pair, mm; inf for none.
        power: Exponent of the cost of a pair.

    Returns:
        (P,) indices of the true points that are paired, (P,) indices of their partners, and (P,)
        distances, mm.
    """
    if not len(truth) or not len(predicted):
        none = np.empty(0, dtype=np.intp)
        return none, none, np.empty(0)
    axes = zip(truth.T, predicted.T, strict=True)
    distance = reduce(np.hypot, (np.abs(np.subtract.outer(*places)) for places in axes))
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


CATCH = "catch"
"""Group of the single presses that are mixed into two-point trials."""
NOT_FINITE, RAISED = 1, 2
"""Ways in which a model can fail on a frame; 0 where it answered."""


@dataclass(frozen=True, eq=False)
class Trials:
    """N test frames answered with contacts.

    Attributes:
        truth: True contacts of every frame.
        predictions: Predicted contacts of every frame.
        press: (N,) press ids, the clusters.
        group: One name per frame ("all"; "dual", "triple"; a true distance such as "6.5"; "catch").
        max_depth: Depth that a heat of 1 stands for, mm.
        gate: Distance from which on two contacts are no pair, mm; inf for none.
        level: Level of the intervals.
        maps: (N, H, W) predicted heatmaps.
        surface: (N, H, W) true inward displacement of the skin, mm.
        floor: (N,) mean square by which the encoder's map of the true contacts differs from the
            surface, mm^2.
        bound: (K, 3) Cramer-Rao standard deviations of x, y and depth of every frame, mm; inf for a
            contact that the frame does not show.
        limit: (N,) two-point limits of the sensor, mm; NaN where it was not computed, inf where
            there is none.
        axes: Axes of the families whose cases the groups are.
        failed: (N,) NOT_FINITE or RAISED where the model failed on a frame, which then has no
            predictions, else 0; None where a failure ends the run.

    Raises:
        ValueError: Lengths do not fit, or a bound is not positive.
    """

    truth: tuple[Contacts, ...]
    predictions: tuple[Contacts, ...]
    press: Labels
    group: tuple[str, ...]
    max_depth: float = 6.0
    gate: float = 3.0
    level: float = 0.95
    maps: npt.NDArray[Any] | None = None
    surface: npt.NDArray[Any] | None = None
    floor: FloatArray | None = None
    bound: tuple[FloatArray, ...] | None = None
    limit: FloatArray | None = None
    axes: tuple[Axis, ...] = ()
    failed: npt.NDArray[np.int8] | None = None

    def __post_init__(self) -> None:
        n = len(self.truth)
        _lengths(n, predictions=self.predictions, press=self.press, group=self.group)
        object.__setattr__(self, "press", np.asarray(self.press))
        for name in ("maps", "surface", "floor", "limit", "failed", "bound"):
            if getattr(self, name) is not None:
                _lengths(n, **{name: getattr(self, name)})
        if not all((bound > 0).all() for bound in self.bound or ()):  # nor is NaN
            raise ValueError("a bound must be positive")
        known = all(true.knows_depth for true in self.truth)
        if known and not all(answer.knows_depth for answer in self.predictions):
            raise ValueError("a depth is not finite, where the truth knows it")

    def __len__(self) -> int:
        return len(self.truth)

    @cached_property
    def matched(self) -> Pairs:
        """Pairs inside the gate."""
        return match_trials(self.truth, self.predictions, self.gate)

    @cached_property
    def ungated(self) -> Pairs:
        """Pairs of the assignment without a gate."""
        return match_trials(self.truth, self.predictions, np.inf)

    @cached_property
    def true_counts(self) -> IntArray:
        """Number of true contacts of every frame, (N,)."""
        return np.array([len(c) for c in self.truth], dtype=np.intp)

    @cached_property
    def predicted_counts(self) -> IntArray:
        """Number of predicted contacts of every frame, (N,)."""
        return np.array([len(c) for c in self.predictions], dtype=np.intp)


@dataclass(frozen=True, eq=False)
class PlateTrials:
    """N test frames answered with plate poses.

    Attributes:
        truth: True pose of every frame.
        predictions: Predicted pose of every frame; None where the frame was not answered.
        press: (N,) press ids, the clusters.
        level: Level of the intervals.
        published: Name of a table -> published predictions of the same N frames.
        group: Group of every frame ("50": answered after 50 labelled frames); () where all frames
            are of one group.

    Raises:
        ValueError: Lengths do not fit, or a predicted pose is not finite.
    """

    truth: tuple[PlatePose | None, ...]
    predictions: tuple[PlatePose | None, ...]
    press: Labels
    level: float = 0.95
    published: Mapping[str, tuple[PlatePose | None, ...]] = field(default_factory=dict)
    group: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _lengths(len(self.truth), predictions=self.predictions, press=self.press, **self.published)
        if self.group:
            _lengths(len(self.truth), group=self.group)
        object.__setattr__(self, "press", np.asarray(self.press))
        given = [pose for pose in self.predictions if pose is not None]
        if not all(map(math.isfinite, (v for pose in given for v in (pose.depth, pose.tilt)))):
            raise ValueError("a plate pose is not finite")

    def __len__(self) -> int:
        return len(self.truth)


@dataclass(frozen=True, eq=False)
class SiteTrials:
    """N test frames answered with the named places that are touched.

    Attributes:
        true: (N, K) whether each place is touched.
        touched: (N, K) whether each place is in the predicted set.
        probability: (N, K) predicted probability that each place is touched.
        press: (N,) ids of the clusters: trials, or sets of places that no training saw.
        group: Group of every frame, see ``tactibench.metrics.sites``.
        level: Level of the intervals.
    """

    true: npt.NDArray[np.bool_]
    touched: npt.NDArray[np.bool_]
    probability: FloatArray
    press: Labels
    group: tuple[str, ...]
    level: float = 0.95

    def __len__(self) -> int:
        return len(self.true)


AnyTrials = Trials | PlateTrials | SiteTrials


def _lengths(n: int, **columns: Any) -> None:
    for name, column in columns.items():
        if len(column) != n:
            raise ValueError(f"{name} has {len(column)} entries for {n} trials")
