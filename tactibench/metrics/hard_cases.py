"""Errors on graded hard cases, where these errors double, and frames on which a model fails."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tactibench.contacts import FloatArray
from tactibench.metrics.detection import finite_gate
from tactibench.metrics.spec import Mask, MetricSpec, Rows, Sample, mean_metric, members
from tactibench.metrics.trials import NOT_FINITE, RAISED, Trials
from tactibench.protocols import UNTOUCHED, Axis, family_of
from tactibench.stats import (
    DOUBLE,
    Estimate,
    doubling,
    mean_ratio,
    rate_interval,
)

THOUSAND = 1000
"""Frames per which false contacts are counted: per frame the numbers would be too small to read."""


def ospa(trials: Trials) -> Sample:
    """Return the OSPA error of every frame, mm, in 0..gate.

        (sum over pairs of min(d, c) + c (max(n, m) - pairs)) / max(n, m)

    with n true and m predicted contacts, c the gate, d the distance in x, y and depth of contacts
    that are paired in the plane; it is 0 where n and m are 0. That is OSPA with p = 1 (Schuhmacher,
    Vo and Vo 2008, equation 3), except for the assignment, which is that of all other metrics.

    Raises:
        UserError: The gate is not finite.
    """
    pairs, count, gate = trials.matched, len(trials), finite_gate(trials, "ospa_mm")
    gap = np.minimum(np.linalg.norm(pairs.error, axis=1), gate)
    most = np.maximum(trials.true_counts, trials.predicted_counts)
    located = np.bincount(pairs.trial, gap, count).astype(np.float64)
    unpaired = most - pairs.per_trial(count)
    return Sample((located + gate * unpaired) / np.maximum(most, 1), np.arange(count))


def error_ratios(trials: Trials, _rng: np.random.Generator) -> Rows:
    """Yield the ratio of ``ospa_mm`` of every graded case to that of its family's easy case."""
    error = ospa(trials).values
    for axis in trials.axes:
        yield from zip(axis.groups, _ratios(trials, error, axis), strict=False)


def worst_ratio(trials: Trials, rng: np.random.Generator) -> Rows:
    """Yield the largest ratio of all cases."""
    ratios = [ratio for _, ratio in error_ratios(trials, rng) if ratio.value is not None]
    yield "all", max(ratios, key=lambda ratio: ratio.value or 0.0, default=Estimate.nothing())


def doubles_at(trials: Trials, _rng: np.random.Generator) -> Rows:
    """Yield for every family the value at which ``ospa_mm`` is twice that of the easy case.

    There is no value where the error of the easy case is more than half the gate: no error exceeds
    the gate, so it cannot double.
    """
    error = ospa(trials).values
    for axis in trials.axes:
        if not axis.ordered or axis.easy is None:
            continue
        ratios = list(_ratios(trials, error, axis))
        doubled = doubling(axis.easy, axis.values, ratios)
        easy = error[members(trials, axis.reference)]
        if len(easy) and DOUBLE * easy.mean() > trials.gate:
            doubled = Estimate(None, None, None, doubled.n, doubled.clusters)
        yield axis.family, doubled


def _ratios(trials: Trials, error: FloatArray, axis: Axis) -> Iterator[Estimate]:
    """Yield the ratios of an axis in its order; nothing for a family without an easy case."""
    if not axis.reference:
        return
    easy = members(trials, axis.reference)
    for group in axis.groups:
        hard = members(trials, group)
        yield mean_ratio(
            error[hard], trials.press[hard], error[easy], trials.press[easy], level=trials.level
        )


def false_per_1000(trials: Trials, _rng: np.random.Generator) -> Rows:
    """Yield the number of predictions per 1,000 frames in which nothing presses.

    The group "all" has the frames without a fault. Where there are frames under faults, too, each
    fault is a group, and "untouched" has all of them together.
    """
    empty = trials.true_counts == 0
    faulted = np.array([family_of(group) == UNTOUCHED for group in trials.group], dtype=bool)
    groups = dict.fromkeys(group for group in trials.group if family_of(group) == UNTOUCHED)
    masks = {group: members(trials, group) for group in groups}
    together = {UNTOUCHED: faulted} if masks else {}
    for name, mask in {**masks, **together, "all": empty & ~faulted}.items():
        rate = rate_interval(trials.predicted_counts[mask], trials.press[mask], level=trials.level)
        limits = (rate.value, rate.low, rate.high)
        value, low, high = (None if x is None else THOUSAND * x for x in limits)
        yield name, Estimate(value, low, high, rate.n, rate.clusters)


def _count(trials: Trials, kind: int) -> Rows:
    """Yield the number of frames on which the model failed in one way, by family and in all.

    There is no value where a failure ends the run.

    Args:
        trials: Test frames.
        kind: The way, NOT_FINITE or RAISED.
    """
    if trials.failed is None:
        yield "all", Estimate.nothing()
        return
    failed = trials.failed == kind
    family = np.array([family_of(group) for group in trials.group], dtype=object)
    masks: dict[str, Mask] = {axis.family: family == axis.family for axis in trials.axes}
    for name, inside in (*masks.items(), ("all", np.ones(len(trials), dtype=bool))):
        presses = len(np.unique(trials.press[inside]))
        yield name, Estimate(float(failed[inside].sum()), None, None, int(inside.sum()), presses)


SPECS = (
    mean_metric(
        "ospa_mm",
        "mm",
        "lower",
        "mean over frames of (sum over pairs of min(d, c) + "
        "c (max(n, m) - pairs)) / max(n, m); n true, m predicted contacts, c = gate, d the "
        "distance in x, y and depth",
        ospa,
    ),
    MetricSpec(
        "error_ratio",
        "",
        "lower",
        "ospa_mm of a case / ospa_mm of the easy case of its family",
        error_ratios,
    ),
    MetricSpec("worst_ratio", "", "lower", "the largest error_ratio of all cases", worst_ratio),
    MetricSpec(
        "doubles_at",
        "",
        "none",
        "value, in the unit of the family, at which error_ratio "
        "reaches 2, linear between the cases; censored '>' or '<' at the hardest case; n/a "
        "where twice the easy case's error exceeds the gate",
        doubles_at,
    ),
    MetricSpec(
        "false_per_1000",
        "per 1,000 frames",
        "lower",
        "predictions in frames without a true contact / such frames x 1000; all: without a fault; "
        "untouched: under a fault",
        false_per_1000,
    ),
    MetricSpec(
        "not_finite",
        "frames",
        "lower",
        "frames answered with NaN or infinity",
        lambda trials, _rng: _count(trials, NOT_FINITE),
    ),
    MetricSpec(
        "raised",
        "frames",
        "lower",
        "frames on which the model raised an exception",
        lambda trials, _rng: _count(trials, RAISED),
    ),
)
