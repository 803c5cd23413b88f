"""Depth, tilt and coverage of plate poses, and both against published predictions.

Errors are means over answered frames; coverage is the share of these frames. Published predictions
of the same frames are compared frame by frame. There is one row for every published table that has
some of these frames, named after the table.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tactibench.metrics.groups import plate_rows
from tactibench.metrics.position import plate_depth_errors, plate_errors
from tactibench.metrics.spec import MetricSpec, Rows, Sample
from tactibench.metrics.trials import PlateTrials
from tactibench.stats import (
    Estimate,
    FloatArray,
    mean_interval,
    positive_mean_interval,
    share_interval,
    sign_flip_p,
)


def tilt_errors(trials: PlateTrials) -> Sample:
    """Return |p - t| of the tilt of every answered frame, deg."""
    return plate_errors(trials, "tilt")


def answered(trials: PlateTrials) -> Sample:
    """Return 1 for every answered frame, 0 for the others."""
    values = np.array([p is not None for p in trials.predictions], dtype=np.float64)
    return Sample(values, np.arange(len(values)))


Errors = Callable[[PlateTrials], Sample]


def differences(trials: PlateTrials, table: str, errors: Errors) -> Sample:
    """Return |p - t| - |q - t| of every frame with both answers, q the published prediction.

    Args:
        trials: Test frames.
        table: Name of the published table.
        errors: Function that returns |p - t| of every answered frame.
    """
    ours = errors(trials)
    theirs = errors(replace(trials, predictions=trials.published[table]))
    _, i, j = np.intersect1d(ours.trial, theirs.trial, return_indices=True)
    return Sample(ours.values[i] - theirs.values[j], ours.trial[i])


def _difference(errors: Errors) -> Callable[[PlateTrials, np.random.Generator], Rows]:
    def rows(trials: PlateTrials, _rng: np.random.Generator) -> Rows:
        for table in trials.published:
            sample = differences(trials, table, errors)
            press = trials.press[sample.trial]
            yield table, mean_interval(sample.values, press, level=trials.level)

    return rows


def _p(errors: Errors) -> Callable[[PlateTrials, np.random.Generator], Rows]:
    def rows(trials: PlateTrials, rng: np.random.Generator) -> Rows:
        for table in trials.published:
            sample = differences(trials, table, errors)
            sums = _by_press(sample, trials)
            if len(sums) > 1:
                p = sign_flip_p(sums, rng=rng)
                yield table, Estimate(p, None, None, len(sample.values), len(sums))

    return rows


def _by_press(sample: Sample, trials: PlateTrials) -> FloatArray:
    """Return the (G,) sums over presses: the signs of a press's frames flip together."""
    _, codes = np.unique(trials.press[sample.trial], return_inverse=True)
    return np.bincount(codes, sample.values).astype(np.float64)


_FORMULA = "mean of |p - t| - |q - t| over frames that both answered, q the released answer"

PLATE_SPECS = (
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

PUBLISHED_SPECS = (
    MetricSpec(
        "depth_mae_minus_published_mm",
        "mm",
        "lower",
        f"{_FORMULA}; of depth",
        plates=_difference(plate_depth_errors),
    ),
    MetricSpec(
        "depth_mae_minus_published_p",
        "p",
        "none",
        "two-sided sign-flip permutation p of the difference in depth, whole presses",
        plates=_p(plate_depth_errors),
    ),
    MetricSpec(
        "tilt_mae_minus_published_deg",
        "deg",
        "lower",
        f"{_FORMULA}; of tilt",
        plates=_difference(tilt_errors),
    ),
    MetricSpec(
        "tilt_mae_minus_published_p",
        "p",
        "none",
        "two-sided sign-flip permutation p of the difference in tilt, whole presses",
        plates=_p(tilt_errors),
    ),
)
PUBLISHED_NAMES = tuple(spec.name for spec in PUBLISHED_SPECS)
"""Metrics that are computed wherever there are published predictions."""

SPECS = (*PLATE_SPECS, *PUBLISHED_SPECS)
