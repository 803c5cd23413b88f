"""The heatmap scored as what it is said to be: the deformed surface."""

from __future__ import annotations

import numpy as np

from tactibench.metrics.groups import by_kind, mean_metric
from tactibench.metrics.spec import Sample
from tactibench.metrics.trials import Trials
from tactibench.stats.intervals import rms_interval


def surface_mean_squares(trials: Trials) -> Sample:
    """Return the mean over cells of (map * max_depth - surface)^2, one value per frame, mm^2."""
    if trials.maps is None or trials.surface is None:
        return Sample(np.empty(0), np.empty(0, dtype=np.intp))
    values = [
        float(np.mean((m.astype(np.float64) * trials.max_depth - s) ** 2))
        for m, s in zip(trials.maps, trials.surface, strict=True)
    ]
    return Sample(np.array(values, dtype=np.float64), np.arange(len(trials)))


SPECS = (
    mean_metric(
        "surface_rmse_mm",
        "mm",
        "lower",
        "sqrt(mean over cells and frames of "
        "(heatmap * max_depth - inward displacement of the skin)^2)",
        surface_mean_squares,
        rms_interval,
        by_kind,
        root=True,
    ),
)
