"""Position and depth error of matched contacts: in the plane, along z, and between the tips."""

from __future__ import annotations

import numpy as np

from tactibench.metrics.groups import by_kind, mean_metric, plate_rows
from tactibench.metrics.matching import runs
from tactibench.metrics.spec import Sample
from tactibench.metrics.trials import PlateTrials, Trials
from tactibench.stats import positive_mean_interval


def gated_distances(trials: Trials) -> Sample:
    """Return the distance of every pair inside the gate, mm."""
    return Sample(trials.matched.distance, trials.matched.trial)


def ungated_distances(trials: Trials) -> Sample:
    """Return the distance of every pair of the assignment without a gate, mm."""
    return Sample(trials.ungated.distance, trials.ungated.trial)


def depth_errors(trials: Trials) -> Sample:
    """Return |p - t| of the depth of every pair inside the gate, mm."""
    pairs = trials.matched
    return Sample(np.abs(pairs.predicted_depth - pairs.true_depth), pairs.trial)


def plate_depth_errors(trials: PlateTrials) -> Sample:
    """Return |p - t| of the depth of every answered frame, mm."""
    return plate_errors(trials, "depth")


def plate_errors(trials: PlateTrials, field: str) -> Sample:
    """Return |p - t| of a field of the pose, such as "tilt", of every answered frame."""
    trial = np.flatnonzero([pose is not None for pose in trials.predictions])
    true = np.array([getattr(trials.truth[i], field) for i in trial], dtype=np.float64)
    predicted = np.array([getattr(trials.predictions[i], field) for i in trial], dtype=np.float64)
    return Sample(np.abs(predicted - true), trial)


def relative_depth_errors(trials: Trials) -> Sample:
    """Return |(p_i - p_j) - (t_i - t_j)| of depth of every two matched contacts of a frame, mm."""
    pairs = trials.matched
    error = pairs.predicted_depth - pairs.true_depth
    values, trial = [np.empty(0)], [np.empty(0, dtype=np.intp)]
    for number, rows in runs(pairs.trial):
        i, j = np.triu_indices(rows.stop - rows.start, k=1)
        values.append(np.abs(error[rows][i] - error[rows][j]))
        trial.append(np.full(len(i), number, dtype=np.intp))
    return Sample(np.concatenate(values), np.concatenate(trial))


SPECS = (
    mean_metric(
        "position_mean_mm",
        "mm",
        "lower",
        "mean |p_xy - t_xy| over pairs inside the gate",
        gated_distances,
        positive_mean_interval,
        by_kind,
    ),
    mean_metric(
        "position_ungated_mm",
        "mm",
        "lower",
        "mean |p_xy - t_xy| over the pairs of the minimum-cost assignment without a gate",
        ungated_distances,
        positive_mean_interval,
        by_kind,
    ),
    mean_metric(
        "depth_mae_mm",
        "mm",
        "lower",
        "mean |p_depth - t_depth| over pairs inside the gate; for plates over answered frames",
        depth_errors,
        positive_mean_interval,
        by_kind,
        plates=plate_rows(plate_depth_errors, positive_mean_interval),
        plate_sample=plate_depth_errors,
    ),
    mean_metric(
        "relative_depth_mae_mm",
        "mm",
        "lower",
        "mean |(p_i - p_j) - (t_i - t_j)| of depth "
        "over every two contacts of a frame that are both matched",
        relative_depth_errors,
        positive_mean_interval,
        by_kind,
    ),
)
