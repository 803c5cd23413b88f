"""Intervals and metrics at the ends: what is not finite is counted and refused, never averaged."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tactibench.contacts import Contacts
from tactibench.metrics import Trials
from tactibench.metrics.registry import score
from tactibench.stats import (
    bca_interval,
    cluster_codes,
    mean_interval,
    positive_mean_interval,
    r_squared,
    rate_interval,
    ratio_interval,
    rms_interval,
    sign_flip_ps,
)

PRESS = np.arange(8)
INTERVALS: dict[str, Callable[[Any], Any]] = {
    "mean": lambda v: mean_interval(v, PRESS),
    "positive mean": lambda v: positive_mean_interval(v, PRESS),
    "rms": lambda v: rms_interval(v, PRESS),
    "rate": lambda v: rate_interval(v, PRESS),
    "ratio": lambda v: ratio_interval(v, np.ones(8), PRESS),
    "ratio below": lambda v: ratio_interval(np.ones(8), v, PRESS),
    "sign flips": lambda v: sign_flip_ps(v[:, None], rng=np.random.default_rng(0)),
    "r squared": lambda v: r_squared(v, np.zeros(8), cluster_codes(PRESS, 8)[0], 8),
}


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", INTERVALS)
def test_a_value_that_is_not_finite_is_counted_and_refused(name: str, bad: float) -> None:
    values = np.ones(8)
    values[3] = bad
    with pytest.raises(ValueError, match="1 of 8 values are not finite"):
        INTERVALS[name](values)


def test_resamples_without_a_value_are_counted_not_averaged() -> None:
    """Half of the resamples give NaN: no interval is made of the other half."""

    def half(weights: np.ndarray) -> np.ndarray:
        values = weights @ np.arange(8.0)
        lost = (weights[:, 0] == 0) & (len(weights) > 8)
        return np.where(lost, np.nan, values)

    assert bca_interval(half, 8, rng=np.random.default_rng(0)) is None


@pytest.mark.parametrize("far", [0.0, 1e-12, 1e6, 1e150])
def test_metrics_of_answers_that_are_exact_or_absurd(far: float) -> None:
    """No warning (they are errors here), no NaN: a value, or none with a reason to be none."""
    truth = tuple(Contacts.truth([[x, 0.0]], [2.0]) for x in np.linspace(-5, 5, 8))
    found = tuple(Contacts(t.xy + far, t.depth + far, np.ones(1)) for t in truth)
    trials = Trials(truth, found, PRESS, ("all",) * 8, gate=3.0)
    names = ("mae_mm", "rmse_mm", "missed", "spurious")
    rows = score(names, trials, rng=np.random.default_rng(0))
    assert {row.metric for row in rows} == set(names)
    for row in rows:
        shown = (row.value, row.low, row.high)
        assert all(value is None or math.isfinite(value) for value in shown)
    missed = next(row.value for row in rows if row.metric == "missed")
    assert missed == (0.0 if far < 1 else 1.0)
