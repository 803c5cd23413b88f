"""Missed, spurious, catch trials and d'."""

from statistics import NormalDist

import numpy as np
import pytest

from tactibench.contacts import Contacts
from tactibench.metrics import Trials, sensitivity
from tactibench.metrics.registry import score
from tactibench.stats import bca_interval

z = NormalDist().inv_cdf


def rows(names, trials):
    found = score(names, trials, rng=np.random.default_rng(0))
    return {(r.metric, r.group): r for r in found}


def test_missed_and_spurious_balance_with_the_matches(kinds):
    found = rows(["missed", "spurious"], kinds)
    for group in ("dual", "triple", "all"):
        frames = [i for i, g in enumerate(kinds.group) if group in ("all", g)]
        true = sum(len(kinds.truth[i]) for i in frames)
        predicted = sum(len(kinds.predictions[i]) for i in frames)
        matched = sum(int((kinds.matched.trial == i).sum()) for i in frames)
        assert found["missed", group].value == pytest.approx((true - matched) / true)
        assert found["missed", group].n == true
        assert found["spurious", group].value == pytest.approx((predicted - matched) / len(frames))
        assert found["spurious", group].n == len(frames)


def test_catch_trials_by_counting(two_point):
    found = rows(["catch_resolved", "d_prime"], two_point)
    counts = {"catch": [], "pair": []}
    for g, p in zip(two_point.group, two_point.predictions, strict=True):
        counts["catch" if g == "catch" else "pair"].append(len(p))
    catch, pair = np.array(counts["catch"]), np.array(counts["pair"])
    assert found["catch_resolved", "all"].value == pytest.approx((catch == 2).mean())
    hit = ((pair >= 2).sum() + 0.5) / (len(pair) + 1)
    alarm = ((catch >= 2).sum() + 0.5) / (len(catch) + 1)
    assert found["d_prime", "all"].value == pytest.approx(z(hit) - z(alarm))


def test_d_prime_of_guessing_is_nought_and_the_rule_is_symmetric():
    press = np.arange(100)
    ones, none = np.ones(100), np.zeros(100)
    half = np.tile([0.0, 1.0], 50)
    assert sensitivity(half, half, press, press, 0.95).value == pytest.approx(0)
    best = sensitivity(ones, none, press, press, 0.95)
    worst = sensitivity(none, ones, press, press, 0.95)
    assert best.value == pytest.approx(-worst.value)
    assert best.low < best.value < best.high


def test_d_prime_interval_agrees_with_bca_away_from_the_ends():
    rng = np.random.default_rng(2)
    hits, alarms = (rng.random(400) < 0.8) * 1.0, (rng.random(400) < 0.3) * 1.0
    press = np.arange(400)
    found = sensitivity(hits, alarms, press, press, 0.95)
    catch = np.repeat([0.0, 1.0], 400)
    both, inverse = np.concatenate([hits, alarms]), np.vectorize(z)

    def difference(weights):
        two, one = ((weights * kind) @ both / (weights @ kind) for kind in (1 - catch, catch))
        return inverse(two) - inverse(one)

    low, high = bca_interval(difference, 800, rng=rng, resamples=4000)
    assert found.low == pytest.approx(low, abs=0.04)
    assert found.high == pytest.approx(high, abs=0.04)


def test_without_catch_trials_there_is_no_d_prime(kinds):
    row = rows(["d_prime"], kinds)["d_prime", "all"]
    assert row.value is None
    assert rows(["catch_resolved"], kinds)["catch_resolved", "all"].value is None


def test_nothing_spurious_still_has_an_upper_limit():
    one = Contacts.truth([[0, 0]], [1])
    row = rows(["spurious"], Trials((one,) * 50, (one,) * 50, np.arange(50), ("all",) * 50))
    row = row["spurious", "all"]
    assert (row.value, row.low) == (0, 0)
    # Poisson with this mean would leave 50 frames untouched with probability 2.5 %
    assert np.exp(-50 * row.high) == pytest.approx(0.025)
