"""Does a model know how wrong it is? Only for models that give ``std``; n/a for others.

With z = (predicted - true) / std of x, y and depth, over pairs inside the gate. The gate cuts the
worst errors off, so `missed` belongs beside these numbers.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from tactibench.contacts import FloatArray
from tactibench.errors import UserError
from tactibench.metrics.groups import by_kind, mean_metric
from tactibench.metrics.spec import Sample
from tactibench.metrics.trials import Trials
from tactibench.stats.clusters import IntArray
from tactibench.stats.intervals import mean_interval, rms_interval, share_interval


def standardised(trials: Trials) -> tuple[FloatArray, FloatArray, IntArray]:
    """(P, 3) z and std of the pairs whose prediction has a std, and (P,) their trials.

    Raises UserError for a std that is not positive.
    """
    pairs = trials.matched
    has = np.array([trials.predictions[i].std is not None for i in pairs.trial], dtype=bool)
    error = np.column_stack(
        [pairs.predicted_xy - pairs.true_xy, pairs.predicted_depth - pairs.true_depth]
    )[has]
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
    return error / std, std, pairs.trial[has]


def log_loss(trials: Trials) -> Sample:
    """Gaussian negative log likelihood of x, y and depth together, one value per pair."""
    z, std, trial = standardised(trials)
    each = z**2 / 2 + np.log(std) + math.log(2 * math.pi) / 2
    return Sample(each.sum(axis=1), trial)


def squared_z(trials: Trials) -> Sample:
    """z^2 averaged over x, y and depth, one value per pair."""
    z, _, trial = standardised(trials)
    return Sample((z**2).mean(axis=1), trial)


def inside_ellipse(trials: Trials, percent: int) -> Sample:
    """1 where the truth lies inside the stated ellipse in the plane: z_x^2 + z_y^2 <= r^2.

    For two independent Gaussians r^2 = -2 log(1 - percent / 100).
    """
    z, _, trial = standardised(trials)
    radius_squared = -2 * math.log(1 - percent / 100)
    hits = (z[:, :2] ** 2).sum(axis=1) <= radius_squared
    return Sample(hits.astype(np.float64), trial)


SPECS = (
    mean_metric("nll", "", "lower", "mean over pairs of sum over x, y, depth of z^2 / 2 + log std "
                "+ log(2 pi) / 2, std in mm", log_loss, mean_interval, by_kind),
    mean_metric("rms_z", "", "none", "sqrt(mean over pairs and x, y, depth of z^2); 1 is honest",
                squared_z, rms_interval, by_kind),
    *(
        mean_metric(f"ellipse_{percent}", "share", "none", f"pairs with the truth inside the "
                    f"stated {percent} % ellipse in the plane / pairs; {percent} % is honest",
                    partial(inside_ellipse, percent=percent), share_interval, by_kind)
        for percent in (50, 90, 95)
    ),
)  # fmt: skip
