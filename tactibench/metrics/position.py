"""Location error of matched contacts, millimetres in the plane."""

from __future__ import annotations

from tactibench.metrics.groups import by_kind, mean_metric
from tactibench.metrics.spec import Sample
from tactibench.metrics.trials import Trials
from tactibench.stats.intervals import positive_mean_interval


def gated_distances(trials: Trials) -> Sample:
    """Distance of every pair inside the gate."""
    return Sample(trials.matched.distance, trials.matched.trial)


def ungated_distances(trials: Trials) -> Sample:
    """Distance of every pair of the assignment without a gate."""
    return Sample(trials.ungated.distance, trials.ungated.trial)


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
)
