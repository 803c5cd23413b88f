"""Stated against real errors."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from tactibench import UserError
from tactibench.contacts import Contacts
from tactibench.metrics import Trials, in_ellipse, spacing
from tactibench.metrics.registry import score

NAMES = ["nll", "rms_z", "ellipse_50", "ellipse_90", "ellipse_95", "std_over_bound"]


def honest(n, claim=1.0, seed=0):
    """Errors drawn with the stated std, which is then multiplied by ``claim``."""
    rng = np.random.default_rng(seed)
    truth, guess = [], []
    for _ in range(n):
        xy = np.array([[0, 0], [9, 0]]) + rng.uniform(-3, 3, 2)
        depth = rng.uniform(1, 5, 2)
        std = rng.uniform(0.05, 0.3, (2, 3))
        e = rng.normal(size=(2, 3)) * std
        truth.append(Contacts.truth(xy, depth))
        guess.append(Contacts(xy + e[:, :2], depth + e[:, 2], [0.6, 0.9], std * claim))
    return Trials(tuple(truth), tuple(guess), np.arange(n), ("dual",) * n)


def rows(trials):
    found = score(NAMES, trials, rng=np.random.default_rng(0))
    return {r.metric: r for r in found if r.group == "all"}


def test_an_honest_model():
    found = rows(honest(3000))
    for name, expected in zip(NAMES[1:5], (1, 0.5, 0.9, 0.95), strict=True):
        assert found[name].value == pytest.approx(expected, abs=0.02)
        assert found[name].n == 6000


def test_sharpness_is_the_stated_std_over_the_bound_of_the_same_contact():
    trials = honest(30, claim=3.0)
    # The better scored prediction is of the second tip.
    bounds = tuple(p.std[[1, 0]] / 2 for p in trials.predictions)
    sharp = rows(replace(trials, bound=bounds))["std_over_bound"]
    assert sharp.value == pytest.approx(2.0)
    assert sharp.n == 60
    unseen = tuple(np.full((2, 3), np.inf) if k % 2 else b for k, b in enumerate(bounds))
    half = rows(replace(trials, bound=unseen))["std_over_bound"]
    assert (half.value, half.n) == (pytest.approx(2.0), 30)
    assert rows(trials)["std_over_bound"].value is None


def test_log_loss_against_scipy():
    trials = honest(40)
    each = [
        -stats.norm.logpdf(
            np.column_stack([p.xy, p.depth]), np.column_stack([t.xy, t.depth])[[1, 0]], p.std
        ).sum(axis=1)
        for t, p in zip(trials.truth, trials.predictions, strict=True)
    ]
    assert rows(trials)["nll"].value == pytest.approx(np.mean(each))


def test_a_model_that_states_nothing_is_not_available(kinds):
    assert {(r.value, r.n) for r in rows(kinds).values()} == {(None, 0)}


def test_a_std_of_nought_is_refused():
    one = Contacts([[0, 0]], [1], [1], [[0.1, 0.0, 0.1]])
    with pytest.raises(UserError, match="must be positive"):
        rows(Trials((one,), (one,), [0], ("dual",)))


def test_spacing_is_to_the_nearest_other():
    assert spacing(np.array([[0, 0], [3, 4], [3, 5]])).tolist() == [5, 1, 1]
    assert spacing(np.array([[1.0, 2.0]])).tolist() == [np.inf]
    assert spacing(np.empty((0, 2))).shape == (0,)


@given(percent=st.floats(0.1, 99.9))
def test_the_radius_of_an_ellipse_is_a_quantile(percent):
    circle = np.sqrt(stats.chi2.ppf(percent / 100, 2))
    turned = np.array([[np.cos(0.7), np.sin(0.7)]])
    assert in_ellipse(0.999 * circle * turned, percent).all()
    assert not in_ellipse(1.001 * circle * turned, percent).any()
