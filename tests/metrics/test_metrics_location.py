"""exp1: top-scored prediction, ungated."""

import numpy as np
import pytest
from sklearn.metrics import mean_absolute_error, mean_squared_error, r2_score

from tactibench import UserError
from tactibench.contacts import Contacts
from tactibench.metrics import Trials
from tactibench.metrics.registry import score


def values(names, trials):
    rows = score(names, trials, rng=np.random.default_rng(0))
    return {(r.metric, r.group): r for r in rows}


def gaussian(n, sigma, seed=0, **options):
    rng = np.random.default_rng(seed)
    true = np.column_stack([rng.uniform(-6.4, 6.4, (n, 2)), rng.uniform(0.5, 6, n)])
    guess = true + rng.normal(0, 1, (n, 3)) * sigma
    as_contact = lambda p: Contacts(p[None, :2], p[2:], [1.0])  # noqa: E731
    return Trials(
        tuple(map(as_contact, true)),
        tuple(map(as_contact, guess)),
        np.arange(n),
        ("all",) * n,
        **options,
    )


def test_against_scikit_learn(singles):
    pairs = [
        ((*t.xy[0], t.depth[0]), (*p.xy[0], p.depth[0]))
        for t, p in zip(singles.truth, singles.predictions, strict=True)
        if len(p)
    ]
    true, guess = np.array(pairs).transpose(1, 0, 2)
    assert 0 < len(true) < len(singles)
    found = values(["mae_mm", "rmse_mm", "r2", "rmse_pooled_mm"], singles)
    raw = {"multioutput": "raw_values"}
    expected = {
        "mae_mm": mean_absolute_error(true, guess, **raw),
        "rmse_mm": np.sqrt(mean_squared_error(true, guess, **raw)),
        "r2": r2_score(true, guess, **raw),
    }
    for metric, per_axis in expected.items():
        for axis, value in zip((*"xyz", "mean"), (*per_axis, per_axis.mean()), strict=True):
            row = found[metric, axis]
            assert row.value == pytest.approx(value)
            assert row.low <= row.value <= row.high
            assert row.n == len(true)
    assert found["rmse_pooled_mm", "all"].value == pytest.approx(
        np.sqrt(mean_squared_error(true, guess))
    )


def test_an_outlier_beyond_the_gate_still_counts():
    truth = (Contacts.truth([[0, 0]], [1]),) * 2
    guess = (Contacts([[9, 0]], [1], [0.5]), Contacts([[0, 0], [5, 5]], [1, 3], [0.9, 0.8]))
    found = values(["mae_mm", "missed"], Trials(truth, guess, np.arange(2), ("all",) * 2))
    assert found["mae_mm", "x"].value == 4.5
    assert found["missed", "all"].value == 0.5


def test_rmse_mean_is_linearised_like_a_jackknife():
    trials = gaussian(400, np.array([0.1, 0.3, 0.2]), seed=5)
    row = values(["rmse_mm"], trials)["rmse_mm", "mean"]
    e = np.array(
        [
            (*(p.xy[0] - t.xy[0]), p.depth[0] - t.depth[0])
            for t, p in zip(trials.truth, trials.predictions, strict=True)
        ]
    )
    left_out = [np.sqrt((np.delete(e, i, 0) ** 2).mean(0)).mean() for i in range(400)]
    deviation = np.sqrt(399 / 400 * ((left_out - np.mean(left_out)) ** 2).sum())
    assert (row.high - row.low) / 2 == pytest.approx(1.966 * deviation, rel=0.01)


def test_a_constant_target_has_no_r2():
    one = Contacts.truth([[1, 2]], [3])
    rows = score(
        ["r2"],
        Trials((one,) * 5, (one,) * 5, np.arange(5), ("all",) * 5),
        rng=np.random.default_rng(0),
    )
    assert [(r.value, r.n) for r in rows] == [(None, 5)] * 4


def test_two_true_contacts_are_refused(kinds):
    with pytest.raises(UserError, match="trial 0 has 2"):
        score(["mae_mm"], kinds, rng=np.random.default_rng(0))
