"""Stated against real errors."""

import numpy as np
import pytest
from scipy import stats

from tactibench import UserError
from tactibench.contacts import Contacts
from tactibench.metrics.score import score
from tactibench.metrics.trials import Trials

NAMES = ["nll", "rms_z", "ellipse_50", "ellipse_90", "ellipse_95"]


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
    for name, expected in zip(NAMES[1:], (1, 0.5, 0.9, 0.95), strict=True):
        assert found[name].value == pytest.approx(expected, abs=0.02)
        assert found[name].n == 6000


def test_boasting_shows_and_costs():
    honestly, boasting = rows(honest(500)), rows(honest(500, claim=0.5))
    assert boasting["rms_z"].value == pytest.approx(2 * honestly["rms_z"].value)
    assert boasting["ellipse_90"].high < honestly["ellipse_90"].low
    assert boasting["nll"].low > honestly["nll"].high


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
