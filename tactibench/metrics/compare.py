"""One metric of two models on the same presses."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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
    means = press_means(name, trials, (group,))[:, 0]
    pressed = np.unique(trials.press)
    known = np.isfinite(means)
    return dict(zip(pressed[known].tolist(), means[known].tolist(), strict=True))


def press_means(
    name: str, trials: Trials | PlateTrials, groups: Sequence[str] = ("all",)
) -> FloatArray:
    """(P, groups) means of a metric's values, of every press of ``np.unique(trials.press)``.

    nan where a press has no value in a group. Raises UserError for a metric that is no mean.
    """
    sample = _sample(name, trials)
    unique, codes = np.unique(trials.press, return_inverse=True)
    columns = []
    for group in groups:
        inside = _members(trials, group)[sample.trial]
        press = codes[sample.trial[inside]]
        sums = np.bincount(press, sample.values[inside], len(unique))
        counts = np.bincount(press, minlength=len(unique))
        columns.append(np.divide(sums, counts, out=np.full(len(unique), np.nan), where=counts > 0))
    return np.stack(columns, axis=1)


def compared_metrics(trials: Trials | PlateTrials, names: Iterable[str]) -> list[str]:
    """Those of the metrics that are means over presses and can be compared press by press."""
    plates = isinstance(trials, PlateTrials)
    specs = map(find_metric, names)
    return [s.name for s in specs if (s.plate_sample if plates else s.sample) and not s.root]


def _members(trials: Trials | PlateTrials, group: str) -> Mask:
    if not isinstance(trials, PlateTrials):
        return members(trials, group)
    everything = np.ones(len(trials), dtype=bool)
    return everything if group == "all" else np.array(trials.group, dtype=object) == group


def _sample(name: str, trials: Trials | PlateTrials) -> Sample:
    spec = find_metric(name)
    if isinstance(trials, PlateTrials):
        if spec.plate_sample is not None:
            return spec.plate_sample(trials)
    elif spec.sample is not None:
        return spec.sample(trials)
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
