"""Named places: is the set of touched places right?

A group is a number of touched places ("2"), or all trials of a test ("all"). Groups of trials that
are scored apart begin with the name of their test ("session:2", "session").
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from tactibench.metrics.spec import Mask, MetricSpec, Rows, Sample, Summary
from tactibench.metrics.trials import SiteTrials
from tactibench.protocols import family_of
from tactibench.stats import (
    Estimate,
    FloatArray,
    mean_interval,
    positive_mean_interval,
    share_interval,
)


def groups(trials: SiteTrials) -> Iterator[tuple[str, Mask]]:
    """Yield every group with its trials, each test by the number of touched places."""
    of = np.array(trials.group, dtype=object)
    apart = {family_of(group) for group in trials.group if ":" in group}
    for test in ("", *sorted(apart)):
        inside = np.array([(family_of(g) if ":" in g else "") == test for g in trials.group])
        for name in sorted(set(of[inside]), key=lambda group: int(group.rpartition(":")[2])):
            yield name, of == name
        yield test or "all", inside


def exact(trials: SiteTrials) -> FloatArray:
    """Return whether the predicted set is the true one, (N,) 0 or 1."""
    return np.asarray((trials.touched == trials.true).all(axis=1), dtype=np.float64)


def told(trials: SiteTrials) -> FloatArray:
    """Return whether the K most probable places are the K touched ones, (N,) 0 or 1."""
    order = np.argsort(-trials.probability, axis=1, kind="stable")
    rank = np.argsort(order, axis=1, kind="stable")
    most = rank < trials.true.sum(axis=1, keepdims=True)
    return np.asarray((most == trials.true).all(axis=1), dtype=np.float64)


def number_error(trials: SiteTrials) -> FloatArray:
    """Return how far the number of predicted places is from the true number, (N,)."""
    count = trials.touched.sum(axis=1) - trials.true.sum(axis=1)
    return np.asarray(np.abs(count), dtype=np.float64)


def brier(trials: SiteTrials) -> FloatArray:
    """Return the squared error of the probabilities, a mean over places, (N,)."""
    return np.asarray(np.square(trials.probability - trials.true).mean(axis=1))


def f1(trials: SiteTrials, _rng: np.random.Generator) -> Rows:
    """Yield F1 of every place, a mean over places; the interval follows by linearising it."""
    hits, named = trials.touched & trials.true, trials.touched.astype(int) + trials.true
    for name, member in groups(trials):
        weight = named[member].mean(axis=0)
        known = weight > 0  # a place that is neither touched nor predicted has no F1
        value = 2 * hits[member].mean(axis=0)[known] / weight[known]
        linear = (2 * hits[member][:, known] - value * named[member][:, known]) / weight[known]
        if not known.any():
            yield name, Estimate.nothing()
            continue
        values = value.mean() + linear.mean(axis=1)
        mean = mean_interval(values, trials.press[member], level=trials.level, floor=0.0)
        yield name, mean if mean.high is None else replace(mean, high=min(mean.high, 1.0))


def _mean(
    name: str,
    unit: str,
    better: str,
    formula: str,
    values: Callable[[SiteTrials], FloatArray],
    summary: Summary,
) -> MetricSpec:
    """Return a metric that is the mean of one value a trial."""

    def make(trials: SiteTrials, _rng: np.random.Generator) -> Rows:
        of = values(trials)
        for group, member in groups(trials):
            yield group, summary(of[member], trials.press[member], level=trials.level)

    return MetricSpec(
        name,
        unit,
        better,
        formula,
        sites=make,
        site_sample=lambda trials: Sample(values(trials), np.arange(len(trials))),
    )


SPECS = (
    _mean(
        "exact", "share", "higher", "share of trials whose set of places is right",
        exact, share_interval,
    ),
    _mean(
        "wrong_set", "share", "lower", "1 - exact",
        lambda trials: 1 - exact(trials), share_interval,
    ),
    _mean(
        "told", "share", "higher",
        "share of trials whose K touched places have the K highest probabilities",
        told, share_interval,
    ),
    MetricSpec(
        "f1", "share", "higher",
        "mean over places of 2 hits / (2 hits + false places + missed places)",
        sites=f1,
    ),
    _mean(
        "number_error", "", "lower", "mean of |number of predicted - number of touched places|",
        number_error, positive_mean_interval,
    ),
    _mean(
        "brier", "", "lower", "mean over trials and places of (probability - touched)^2",
        brier, positive_mean_interval,
    ),
)  # fmt: skip
