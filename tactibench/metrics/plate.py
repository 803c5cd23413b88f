"""Depth, tilt and coverage of plate poses. Errors are over answered frames; coverage beside."""

from __future__ import annotations

import numpy as np

from tactibench.metrics.groups import plate_rows
from tactibench.metrics.spec import MetricSpec, Sample
from tactibench.metrics.trials import PlateTrials
from tactibench.stats.intervals import positive_mean_interval, share_interval


def depth_errors(trials: PlateTrials) -> Sample:
    """|p - t| of the depth of every answered frame, mm."""
    return _errors(trials, "depth")


def tilt_errors(trials: PlateTrials) -> Sample:
    """|p - t| of the tilt of every answered frame, deg."""
    return _errors(trials, "tilt")


def answered(trials: PlateTrials) -> Sample:
    """1 for an answered frame, 0 for another."""
    values = np.array([p is not None for p in trials.predictions], dtype=np.float64)
    return Sample(values, np.arange(len(values)))


def _errors(trials: PlateTrials, field: str) -> Sample:
    trial = np.flatnonzero(answered(trials).values)
    true = np.array([getattr(trials.truth[i], field) for i in trial], dtype=np.float64)
    predicted = np.array([getattr(trials.predictions[i], field) for i in trial], dtype=np.float64)
    return Sample(np.abs(predicted - true), trial)


SPECS = (
    MetricSpec(
        "tilt_mae_deg",
        "deg",
        "lower",
        "mean |p_tilt - t_tilt| over answered frames",
        plates=plate_rows(tilt_errors, positive_mean_interval),
        plate_sample=tilt_errors,
    ),
    MetricSpec(
        "coverage",
        "share",
        "higher",
        "answered frames / frames",
        plates=plate_rows(answered, share_interval),
        plate_sample=answered,
    ),
)
