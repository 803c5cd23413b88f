"""Two-point trials: whether the pair is resolved, its distance and its orientation.

*Resolved* means exactly two predictions, both matched inside the gate.
"""

from __future__ import annotations

import numpy as np

from tactibench.contacts import FloatArray
from tactibench.errors import UserError
from tactibench.metrics.groups import Mask, by_condition, mean_metric, members
from tactibench.metrics.spec import Sample
from tactibench.metrics.trials import Trials
from tactibench.stats import IntArray, positive_mean_interval, share_interval

UNDEFINED_AXIS_DEG = 45.0
"""Error of a pair whose two predictions coincide: the mean error of a random axis."""


def two_point_trials(trials: Trials) -> IntArray:
    """Return the indices of all trials but catch trials.

    Raises:
        UserError: A trial that is no catch trial has another number of true contacts than two.
    """
    index = np.flatnonzero(members(trials, "all"))
    for i in index[trials.true_counts[index] != 2]:
        raise UserError(
            f"the metrics of two-point trials (distance_mae_mm, resolved, threshold_mm ...) need "
            f"two true contacts a trial, but trial {i} of group {trials.group[i]!r} has "
            f"{trials.true_counts[i]}: take them out of the protocol or mark it 'catch'."
        )
    return index


def is_resolved(trials: Trials) -> Mask:
    """Return (N,) whether a trial has exactly two predictions, both matched inside the gate."""
    matched = trials.matched.per_trial(len(trials))
    counted = (trials.predicted_counts == 2) & (trials.true_counts == 2)
    return np.asarray(counted & (matched == 2))


def resolved(trials: Trials) -> Sample:
    """Return 1 for every resolved two-point trial, 0 for the others."""
    index = two_point_trials(trials)
    return Sample(is_resolved(trials)[index].astype(np.float64), index)


def pair_vectors(trials: Trials) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the vectors between the two contacts of resolved trials.

    Returns:
        (n, 2) vectors between the true tips, (n, 2) vectors between their partners, mm, and (n,)
        their trials.
    """
    index = two_point_trials(trials)
    index = index[is_resolved(trials)[index]]
    pairs = trials.matched
    rows = np.isin(pairs.trial, index)
    true, predicted = pairs.true_xy[rows], pairs.predicted_xy[rows]
    return true[1::2] - true[::2], predicted[1::2] - predicted[::2], index


def distance_errors(trials: Trials) -> Sample:
    """Return |predicted - true distance of the pair| of every resolved trial, mm."""
    true, predicted, index = pair_vectors(trials)
    return Sample(np.abs(_length(predicted) - _length(true)), index)


def penalised_distance_errors(trials: Trials) -> Sample:
    """Return the errors of `distance_errors`, and the true distance of trials not resolved, mm."""
    index = two_point_trials(trials)
    tips = np.array([trials.truth[i].xy for i in index]).reshape(-1, 2, 2)
    values = np.zeros(len(trials))
    values[index] = _length(tips[:, 1] - tips[:, 0])
    errors = distance_errors(trials)
    values[errors.trial] = errors.values
    return Sample(values[index], index)


def orientation_errors(trials: Trials) -> Sample:
    """Return the angle between the true and predicted axis of resolved trials, 0..90 deg."""
    true, predicted, index = pair_vectors(trials)
    cross = true[:, 0] * predicted[:, 1] - true[:, 1] * predicted[:, 0]
    dot = (true * predicted).sum(axis=1)
    angle = np.degrees(np.arctan2(np.abs(cross), np.abs(dot)))
    undefined = (cross == 0) & (dot == 0)
    return Sample(np.where(undefined, UNDEFINED_AXIS_DEG, angle), index)


def _length(vectors: FloatArray) -> FloatArray:
    return np.hypot(vectors[:, 0], vectors[:, 1])


SPECS = (
    mean_metric(
        "distance_mae_mm",
        "mm",
        "lower",
        "mean | |p_1 - p_2| - |t_1 - t_2| | over resolved trials",
        distance_errors,
        positive_mean_interval,
        by_condition,
    ),
    mean_metric(
        "distance_penalised_mm",
        "mm",
        "lower",
        "as distance_mae_mm over all trials; one that is not resolved counts |t_1 - t_2|",
        penalised_distance_errors,
        positive_mean_interval,
        by_condition,
    ),
    mean_metric(
        "resolved",
        "share",
        "higher",
        "trials with exactly two predictions, both matched inside the gate / trials",
        resolved,
        share_interval,
        by_condition,
    ),
    mean_metric(
        "orientation_mae_deg",
        "deg",
        "lower",
        "mean angle between the axes through the "
        "two true and the two predicted contacts, modulo 180 deg, over resolved trials",
        orientation_errors,
        positive_mean_interval,
        by_condition,
    ),
)
