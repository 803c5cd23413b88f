"""The difference of two rows with its interval over presses and seeds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from tactibench.board import PressErrors, row_difference, rows_of
from tactibench.stats import crossed_interval, welch_p_values

PRESSES = np.array([f"p{k:03d}" for k in range(200)])


def rows_with(fabricate, values):
    """Two rows of exp1, and their errors. values: model -> (seeds, presses)."""
    errors, made = {}, []
    for name, table in values.items():
        for seed, own in enumerate(table):
            record = fabricate(model=name, encoder=None, seed=seed)
            record.identity.weights_hash = f"{name}{seed}"
            row = record.metric("gospa1_mm", "all")
            row.value, row.low, row.high = own.mean(), own.mean() - 0.1, own.mean() + 0.1
            row.clusters = len(own)
            errors[record.name] = PressErrors(PRESSES[: len(own)], own)
            made.append(record)
    return *rows_of(made), errors


def drawn(seeds, presses=200, scatter=0.02):
    rng = np.random.default_rng(0)
    hard = rng.gamma(2, 0.5, presses)
    return {
        name: hard
        + shift
        + rng.normal(0, scatter, (seeds, 1))
        + rng.normal(0, 0.1, (seeds, presses))
        for name, shift in (("a", 0.3), ("b", 0.0))
    }


def test_the_variance_is_the_sum_over_presses_and_seeds(fabricate):
    values = drawn(3)
    found = row_difference("exp1", *rows_with(fabricate, values))
    one, other = (table.mean(axis=0) for table in values.values())
    terms = [
        (np.var(one - other, ddof=1) / 200, 199),
        *((np.var(table.mean(axis=1), ddof=1) / 3, 2) for table in values.values()),
    ]
    total = sum(v for v, _ in terms)
    freedom = total**2 / sum(v**2 / f for v, f in terms)
    seeds = sum(v for v, _ in terms[1:])
    freedom_seeds = seeds**2 / sum(v**2 / f for v, f in terms[1:])
    half = max(
        stats.t.ppf(0.975, freedom) * np.sqrt(total),
        stats.t.ppf(0.975, freedom_seeds) * np.sqrt(seeds),
    )
    mean = (one - other).mean()
    assert found.presses == 200
    assert (found.value, found.low, found.high) == pytest.approx((mean, mean - half, mean + half))


def test_without_seeds_it_is_the_paired_t_interval():
    rng = np.random.default_rng(1)
    apart = rng.normal(0.1, 1, 50)
    wanted = stats.ttest_1samp(apart, 0).confidence_interval(0.95)
    low, high = crossed_interval(apart.mean(), (apart.var(ddof=1) / 50, 49.0), (), 0.95)
    assert (low, high) == pytest.approx((wanted.low, wanted.high))
    assert crossed_interval(0.5, (0.0, 49.0), (), 0.95) == (0.5, 0.5)


@pytest.mark.parametrize("difference", [0.1, 0.2, 0.3, 0.4, 0.6])
def test_an_interval_holds_0_where_the_p_value_says_so(difference):
    presses, seeds = (0.01, 99.0), [(0.004, 2.0), (0.002, 2.0)]
    terms = [(np.array([v]), np.array([f])) for v, f in [*seeds, presses]]
    p = max(
        welch_p_values(np.array([difference]), terms)[0],
        welch_p_values(np.array([difference]), terms[:-1])[0],
    )
    low, high = crossed_interval(difference, presses, seeds, 0.95)
    assert (low <= 0 <= high) == (p >= 0.05)


def test_there_is_none_with_too_few_seeds_or_other_presses(fabricate):
    assert row_difference("exp1", *rows_with(fabricate, drawn(2))) is None
    values = drawn(3)
    values["b"] = values["b"][:, :150]
    assert row_difference("exp1", *rows_with(fabricate, values)) is None
