"""Plate poses against answers that somebody released to the same frames, frame for frame.

A row for every published table with such answers, named by the table; none where there is none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tactibench.metrics.plate import depth_errors, tilt_errors
from tactibench.metrics.spec import MetricSpec, Rows, Sample
from tactibench.metrics.trials import PlateTrials
from tactibench.stats.clusters import FloatArray
from tactibench.stats.estimate import Estimate
from tactibench.stats.intervals import mean_interval
from tactibench.stats.paired import sign_flip_p

Errors = Callable[[PlateTrials], Sample]


def differences(trials: PlateTrials, table: str, errors: Errors) -> Sample:
    """|p - t| - |q - t| of every frame that both answered, q the released answer."""
    ours = errors(trials)
    theirs = errors(replace(trials, predictions=trials.released[table]))
    _, i, j = np.intersect1d(ours.trial, theirs.trial, return_indices=True)
    return Sample(ours.values[i] - theirs.values[j], ours.trial[i])


def _difference(errors: Errors) -> Callable[[PlateTrials, np.random.Generator], Rows]:
    def rows(trials: PlateTrials, _rng: np.random.Generator) -> Rows:
        for table in trials.released:
            found = differences(trials, table, errors)
            press = trials.press[found.trial]
            yield table, mean_interval(found.values, press, level=trials.level)

    return rows


def _p(errors: Errors) -> Callable[[PlateTrials, np.random.Generator], Rows]:
    def rows(trials: PlateTrials, rng: np.random.Generator) -> Rows:
        for table in trials.released:
            found = differences(trials, table, errors)
            sums = _by_press(found, trials)
            if len(sums) > 1:
                p = sign_flip_p(sums, rng=rng)
                yield table, Estimate(p, None, None, len(found.values), len(sums))

    return rows


def _by_press(found: Sample, trials: PlateTrials) -> FloatArray:
    """(G,) sums over presses: the signs of a press's frames flip together."""
    _, codes = np.unique(trials.press[found.trial], return_inverse=True)
    return np.bincount(codes, found.values).astype(np.float64)


_FORMULA = "mean of |p - t| - |q - t| over frames that both answered, q the released answer"

SPECS = (
    MetricSpec(
        "depth_mae_minus_published_mm",
        "mm",
        "lower",
        f"{_FORMULA}; of depth",
        plates=_difference(depth_errors),
    ),
    MetricSpec(
        "depth_mae_minus_published_p",
        "p",
        "none",
        "two-sided sign-flip permutation p of the difference in depth, whole presses",
        plates=_p(depth_errors),
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
NAMES = tuple(spec.name for spec in SPECS)
