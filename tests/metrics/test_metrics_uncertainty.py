"""Stated against real errors."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from tactibench import UserError
from tactibench.contacts import Contacts
from tactibench.metrics import Trials, gaussian_loss, in_ellipse, in_interval, over_bound, spacing
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


def test_boasting_shows_and_costs():
    honestly, boasting = rows(honest(500)), rows(honest(500, claim=0.5))
    assert boasting["rms_z"].value == pytest.approx(2 * honestly["rms_z"].value)
    assert boasting["ellipse_90"].high < honestly["ellipse_90"].low
    assert boasting["nll"].low > honestly["nll"].high


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


def test_share_inside_is_nominal_for_gaussians():
    z = np.random.default_rng(1).normal(size=(40_000, 3))
    for percent in (50, 90, 95):
        share = percent / 100
        assert in_ellipse(z, percent).mean() == pytest.approx(share, abs=0.01)
        assert in_interval(z[:, 2], percent).mean() == pytest.approx(share, abs=0.01)


@given(percent=st.floats(0.1, 99.9))
def test_limits_are_quantiles(percent):
    circle = np.sqrt(stats.chi2.ppf(percent / 100, 2))
    line = stats.norm.ppf(0.5 + percent / 200)
    turned = np.array([[np.cos(0.7), np.sin(0.7)]])
    for limit, inside in (
        (circle, lambda r: in_ellipse(r * turned, percent)),
        (line, lambda r: in_interval(np.array([r]), percent)),
    ):
        assert inside(0.999 * limit).all()
        assert not inside(1.001 * limit).any()


def test_gaussian_loss_is_least_for_the_true_std():
    error = np.random.default_rng(2).normal(size=(5000, 3)) * 0.2
    losses = [gaussian_loss(error / s, np.full((5000, 3), s)).mean() for s in (0.1, 0.2, 0.4)]
    assert losses[1] == pytest.approx(3 * (0.5 + np.log(0.2 * np.sqrt(2 * np.pi))), abs=0.05)
    assert losses[1] == min(losses)


def test_an_efficient_estimate_stands_at_the_bound():
    rng = np.random.default_rng(3)
    bound = rng.uniform(0.001, 0.1, (20_000, 3))
    rmse, bias = over_bound(bound * rng.normal(size=bound.shape), bound)
    assert rmse == pytest.approx([1, 1, 1], abs=0.03)
    assert bias == pytest.approx([0, 0, 0], abs=0.03)


@given(
    error=arrays(float, (6, 2), elements=st.floats(-1, 1)),
    bound=arrays(float, (6, 2), elements=st.floats(0.01, 1)),
)
def test_bias_and_scatter_add_up_in_squares(error, bound):
    rmse, bias = over_bound(error, bound)
    scatter = error.std(axis=0) / np.sqrt((bound**2).mean(axis=0))
    assert rmse**2 == pytest.approx(bias**2 + scatter**2, abs=1e-9)


def test_a_pair_without_a_bound_is_left_out_axis_by_axis():
    error = np.array([[3.0, 1.0, 1.0], [99.0, -1.0, 1.0]])
    bound = np.array([[1.0, 1.0, np.inf], [np.inf, 1.0, np.nan]])
    rmse, bias = over_bound(error, bound)
    assert rmse == pytest.approx([3, 1, np.nan], nan_ok=True)
    assert bias == pytest.approx([3, 0, np.nan], nan_ok=True)
    assert np.isnan(over_bound(np.empty((0, 3)), np.empty((0, 3)))[0]).all()


def test_spacing_is_to_the_nearest_other():
    assert spacing(np.array([[0, 0], [3, 4], [3, 5]])).tolist() == [5, 1, 1]
    assert spacing(np.array([[1.0, 2.0]])).tolist() == [np.inf]
    assert spacing(np.empty((0, 2))).shape == (0,)
