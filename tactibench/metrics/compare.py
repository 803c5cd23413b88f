"""One metric of two models on the same presses."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactibench.contacts import FloatArray
from tactibench.errors import UserError
from tactibench.metrics.groups import Mask, members
from tactibench.metrics.registry import METRICS, find_metric
from tactibench.metrics.spec import Sample
from tactibench.metrics.trials import PlateTrials, Trials
from tactibench.stats.paired import PairedDifference, paired_difference


def per_press(name: str, trials: Trials | PlateTrials, group: str = "all") -> dict[Any, float]:
    """Mean of a metric's values for each press that has one (squares, for a root mean square).

    Raises UserError for a metric that is no mean over presses.
    """
    sample, inside = _sample(name, trials, group)
    press = trials.press[sample.trial[inside]]
    unique, codes = np.unique(press, return_inverse=True)
    means = np.bincount(codes, sample.values[inside]) / np.bincount(codes)
    return dict(zip(unique.tolist(), means.tolist(), strict=True))


def _sample(name: str, trials: Trials | PlateTrials, group: str) -> tuple[Sample, Mask]:
    spec = find_metric(name)
    if isinstance(trials, PlateTrials):
        if spec.plate_sample is not None:
            sample = spec.plate_sample(trials)
            return sample, np.ones(len(sample.trial), dtype=bool)
    elif spec.sample is not None:
        sample = spec.sample(trials)
        return sample, members(trials, group)[sample.trial]
    able = sorted(n for n, s in METRICS.items() if s.sample or s.plate_sample)
    raise UserError(
        f"metric {name!r} is no mean over presses and cannot be compared press by press: "
        f"choose one of {', '.join(able)}."
    )


def paired_values(
    name: str,
    first: Trials | PlateTrials,
    second: Trials | PlateTrials,
    group: str = "all",
) -> tuple[list[Any], FloatArray, FloatArray]:
    """Presses on which both models have a value, and (G,) values of either."""
    a, b = per_press(name, first, group), per_press(name, second, group)
    shared = [press for press in a if press in b]
    return shared, np.array([a[p] for p in shared]), np.array([b[p] for p in shared])


def compare(
    name: str,
    first: Trials | PlateTrials,
    second: Trials | PlateTrials,
    *,
    rng: np.random.Generator,
    group: str = "all",
) -> PairedDifference:
    """First minus second over the presses both answered, with interval and permutation p."""
    _, a, b = paired_values(name, first, second, group)
    return paired_difference(a, b, rng=rng, level=first.level)
