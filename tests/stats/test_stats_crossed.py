"""Differences of models over presses and seeds: closed forms, and the rates that are promised."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from tactibench.stats import adjust_pairs, crossed_p_values, welch_p_values


def by_hand(one, other):
    """The p values of two models of (seeds, presses) errors, from the formulas in ten lines."""
    press = one.mean(axis=0) - other.mean(axis=0)
    terms = [(press.var(ddof=1) / len(press), len(press) - 1)]
    seeds = [(e.mean(axis=1).var(ddof=1) / len(e), len(e) - 1) for e in (one, other) if len(e) > 1]

    def p(terms):
        variance = sum(v for v, _ in terms)
        freedom = variance**2 / sum(v**2 / n for v, n in terms)
        return 2 * stats.t.sf(abs(press.mean()) / np.sqrt(variance), freedom)

    return max(p(terms + seeds), p(seeds) if seeds else 0.0)


def p_of(models):
    means = np.array([one.mean(axis=0) for one in models])
    covariance = np.cov(means)
    own = np.diag(covariance)
    spread = own[:, None] + own - 2 * covariance
    value = means.mean(axis=1)
    presses = np.full(spread.shape, float(means.shape[1]))
    seeds = np.array([float(len(one)) if len(one) > 1 else 0.0 for one in models])
    of_seeds = [one.mean(axis=1).var(ddof=1) / len(one) if len(one) > 1 else 0.0 for one in models]
    return crossed_p_values(
        value[:, None] - value, spread / means.shape[1], presses, np.array(of_seeds), seeds
    )


def test_p_values_are_those_by_hand() -> None:
    rng = np.random.default_rng(0)
    models = [rng.normal(0.3 * k, 1, (s, 40)) for k, s in enumerate((2, 4, 1, 5))]
    found = p_of(models)
    for k, one in enumerate(models):
        for i, other in enumerate(models[:k]):
            assert found[k, i] == pytest.approx(by_hand(one, other), rel=1e-9)
            assert found[i, k] == found[k, i]


def test_one_term_is_the_t_test_and_two_are_that_of_welch() -> None:
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=8), rng.normal(1, 3, size=5)
    difference = np.array([a.mean() - b.mean()])
    terms = [(np.array([x.var(ddof=1) / len(x)]), np.array([len(x) - 1.0])) for x in (a, b)]
    welch = stats.ttest_ind(a, b, equal_var=False).pvalue
    assert welch_p_values(difference, terms)[0] == pytest.approx(welch)
    alone = welch_p_values(np.array([a.mean()]), terms[:1])[0]
    assert alone == pytest.approx(stats.ttest_1samp(a, 0).pvalue)


def test_without_any_variance_only_equal_models_are_equal() -> None:
    zero = np.zeros(2)
    p = welch_p_values(np.array([0.0, 0.1]), [(zero, np.ones(2))])
    assert p.tolist() == [1.0, 0.0]


@pytest.mark.parametrize("models", [2, 3, 7])
def test_pairs_are_adjusted_as_one_family(models: int) -> None:
    p, upper = np.ones((models, models)), np.triu_indices(models, 1)
    p[upper] = np.random.default_rng(models).random(len(upper[0])) ** 3
    adjusted = adjust_pairs(np.minimum(p, p.T))
    assert adjusted[upper] == pytest.approx(stats.false_discovery_control(p[upper]))
    assert (adjusted == adjusted.T).all()
    assert adjust_pairs(np.ones((1, 1))).tolist() == [[1.0]]


@pytest.mark.parametrize(("models", "seed_sd", "press_sd"), [(2, 0.1, 0.0), (6, 0.05, 0.5)])
def test_equal_models_are_told_apart_in_one_table_of_twenty_at_most(
    models: int, seed_sd: float, press_sd: float
) -> None:
    """Seeds move every press of a model by the same; presses are as hard for one as for another."""
    rng = np.random.default_rng(2)
    tables = 600
    split = 0
    for _ in range(tables):
        hard = rng.gamma(2, 1, 100)
        table = [
            hard + rng.normal(0, press_sd, 100) + rng.normal(0, seed_sd, (3, 1))
            for _ in range(models)
        ]
        split += bool((adjust_pairs(p_of(table)) < 0.05).any())
    # Two standard deviations of a share of 5 % in so many tables are 1.8 %.
    assert split / tables < 0.05 + 0.018
