"""Stated uncertainty against the errors, for models that give ``std``; n/a for other models.

z = (predicted - true) / std of x, y and depth, over pairs inside the gate. The gate cuts off the
worst errors, so these numbers should be read together with `missed`.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy.spatial.distance import cdist

from tactibench.contacts import FloatArray
from tactibench.errors import UserError
from tactibench.metrics.spec import MetricSpec, Rows, Sample, mean_metric, members
from tactibench.metrics.trials import Trials
from tactibench.stats import (
    Estimate,
    IntArray,
    mean_interval,
    ratio_interval,
    rms_interval,
    root,
    share_interval,
)


def standardised(trials: Trials) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return (P, 3) z and std, mm, of pairs whose prediction has a std, and (P,) their trials.

    Raises:
        UserError: A stated std is not positive.
    """
    pairs, has = trials.matched, _is_stated(trials)
    std = np.array(
        [
            stated[j]
            for i, j in zip(pairs.trial[has], pairs.prediction[has], strict=True)
            if (stated := trials.predictions[i].std) is not None
        ]
    ).reshape(-1, 3)
    if not (std > 0).all():
        raise UserError(
            f"the model states a std of {std.min()} mm, it must be positive: let predict return "
            f"std=None where the model does not know its error."
        )
    return pairs.error[has] / std, std, pairs.trial[has]


def _is_stated(trials: Trials) -> npt.NDArray[np.bool_]:
    """Return whether the prediction of each pair inside the gate has a std, (P,)."""
    return np.array([trials.predictions[i].std is not None for i in trials.matched.trial], bool)


def std_over_bound(trials: Trials, _rng: np.random.Generator) -> Rows:
    """Yield sqrt(sum std^2 / sum b^2) over x, y and depth, b the Cramer-Rao standard deviation.

    That is the sharpness of what a model states; the frames allow 1. It does not tell whether the
    errors are as small, which ``rms_z`` does. Pairs without a finite bound are left out of both
    sums.
    """
    if trials.bound is None:
        yield "all", Estimate.nothing()
        return
    _, std, trial = standardised(trials)
    places = zip(trial, trials.matched.truth[_is_stated(trials)], strict=True)
    bound = np.array([trials.bound[i][k] for i, k in places]).reshape(-1, 3)
    bounded = np.isfinite(bound).all(axis=1) & members(trials, "all")[trial]
    yield (
        "all",
        root(
            ratio_interval(
                (std[bounded] ** 2).sum(axis=1),
                (bound[bounded] ** 2).sum(axis=1),
                trials.press[trial[bounded]],
                level=trials.level,
                floor=0.0,
            )
        ),
    )


def gaussian_loss(z: FloatArray, std: FloatArray) -> FloatArray:
    """Return the sum over the columns of -log N(error; 0, std), (P,), where error = z std.

    Args:
        z: (P, C) errors over std.
        std: (P, C) mm.
    """
    each = z**2 / 2 + np.log(std) + math.log(2 * math.pi) / 2
    return np.asarray(each.sum(axis=1), dtype=np.float64)


def in_ellipse(z: FloatArray, percent: float) -> npt.NDArray[np.bool_]:
    """Return (P,) whether z lies in the ellipse that holds ``percent`` % of two Gaussians.

    The condition is z_x^2 + z_y^2 <= r^2 = -2 log(1 - percent / 100).

    Args:
        z: (P, 2 or more), x and y first.
        percent: In 0..100.
    """
    inside = (z[:, :2] ** 2).sum(axis=1) <= -2 * math.log(1 - percent / 100)
    return np.asarray(inside, dtype=np.bool_)


def spacing(xy: FloatArray) -> FloatArray:
    """Return the distance of each contact (K, 2) to its nearest other in the plane, (K,) mm.

    It is inf for a single contact.
    """
    if not len(xy):
        return np.empty(0)
    apart = cdist(xy, xy)
    np.fill_diagonal(apart, np.inf)
    return np.asarray(apart.min(axis=1), dtype=np.float64)


def log_loss(trials: Trials) -> Sample:
    """Return the Gaussian negative log likelihood of x, y and depth, one value per pair."""
    z, std, trial = standardised(trials)
    return Sample(gaussian_loss(z, std), trial)


def squared_z(trials: Trials) -> Sample:
    """Return z^2 averaged over x, y and depth, one value per pair."""
    z, _, trial = standardised(trials)
    return Sample((z**2).mean(axis=1), trial)


def inside_ellipse(trials: Trials, percent: int) -> Sample:
    """Return 1 for every pair whose truth lies in the stated ellipse in the plane, 0 for others.

    See ``in_ellipse``.
    """
    z, _, trial = standardised(trials)
    return Sample(in_ellipse(z, percent).astype(np.float64), trial)


SPECS = (
    mean_metric(
        "nll",
        "",
        "lower",
        "mean over pairs of sum over x, y, depth of z^2 / 2 + log std + log(2 pi) / 2, std in mm",
        log_loss,
        mean_interval,
    ),
    mean_metric(
        "rms_z",
        "",
        "none",
        "sqrt(mean over pairs and x, y, depth of z^2); 1 is honest",
        squared_z,
        rms_interval,
        root=True,
    ),
    *(
        mean_metric(
            f"ellipse_{percent}",
            "share",
            "none",
            f"pairs with the truth inside the "
            f"stated {percent} % ellipse in the plane / pairs; {percent} % is honest",
            partial(inside_ellipse, percent=percent),
            share_interval,
        )
        for percent in (50, 90, 95)
    ),
    MetricSpec(
        "std_over_bound",
        "",
        "none",
        "sqrt(sum std^2 / sum b^2) over pairs and x, y, depth, b the Cramer-Rao standard "
        "deviation; 1 is as sharp as the frames allow",
        std_over_bound,
    ),
)
