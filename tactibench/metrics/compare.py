"""A metric press by press, for the comparison of models on the same presses."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from tactibench.contacts import FloatArray
from tactibench.errors import UserError
from tactibench.metrics.groups import Mask, members
from tactibench.metrics.registry import all_metrics, find_metric
from tactibench.metrics.spec import Sample
from tactibench.metrics.trials import PlateTrials, Trials


def press_means(
    name: str, trials: Trials | PlateTrials, groups: Sequence[str] = ("all",)
) -> FloatArray:
    """Return the means of a metric's values, (P, groups), NaN where a press has none in a group.

    Args:
        name: Name of the metric.
        trials: Test frames, of which ``np.unique(trials.press)`` are the P presses.
        groups: Names of groups of trials.

    Raises:
        UserError: The metric is no mean over presses of trials of this kind.
    """
    columns = []
    for group in groups:
        sums, counts = _press_sums(name, trials, group)
        columns.append(np.divide(sums, counts, out=np.full(len(sums), np.nan), where=counts > 0))
    return np.stack(columns, axis=1)


def press_shares(name: str, trials: Trials | PlateTrials, group: str = "all") -> FloatArray:
    """Return what each press has of a metric: (P,) values with the metric as their mean.

    It is the sum of a press's values over the mean number of values of a press, and so the mean of
    the press where all have the same number. NaN where a press has no value.

    Args:
        name: Name of the metric.
        trials: Test frames, of which ``np.unique(trials.press)`` are the P presses.
        group: Name of a group of trials.

    Raises:
        UserError: The metric is no mean over presses of trials of this kind.
    """
    sums, counts = _press_sums(name, trials, group)
    number = counts.sum() / max(np.count_nonzero(counts), 1)
    shares = np.full(len(sums), np.nan)
    np.divide(sums, number, out=shares, where=counts > 0)
    return shares


def _press_sums(
    name: str, trials: Trials | PlateTrials, group: str
) -> tuple[FloatArray, npt.NDArray[np.intp]]:
    """Return the sum of a metric's values, and their number, of every press."""
    sample = _sample(name, trials)
    unique, codes = np.unique(trials.press, return_inverse=True)
    inside = _members(trials, group)[sample.trial]
    press = codes[sample.trial[inside]]
    sums: FloatArray = np.bincount(press, sample.values[inside], len(unique)).astype(np.float64)
    return sums, np.bincount(press, minlength=len(unique))


def compared_metrics(trials: Trials | PlateTrials, names: Iterable[str]) -> list[str]:
    """Return the metrics that are means over presses and can be compared press by press."""
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
    able = sorted(n for n, s in all_metrics().items() if s.sample or s.plate_sample)
    raise UserError(
        f"metric {name!r} is no mean over presses and cannot be compared press by press: "
        f"choose one of {', '.join(able)}."
    )
