"""Two models on the same presses."""

import numpy as np
import pytest

from tactibench import UserError
from tactibench.contacts import PlatePose
from tactibench.metrics.compare import compare, paired_values, per_press
from tactibench.metrics.trials import PlateTrials


def test_values_are_means_of_each_press(kinds):
    found = per_press("spurious", kinds, "triple")
    extra = [
        len(p) - int((kinds.matched.trial == i).sum()) for i, p in enumerate(kinds.predictions)
    ]
    assert len(found) == 30
    for press, value in found.items():
        frames = np.flatnonzero(kinds.press == press)
        assert value == pytest.approx(np.mean([extra[i] for i in frames]))


def test_only_shared_presses_are_compared(make_trials):
    groups = ["dual"] * 80
    first = make_trials(np.random.default_rng(5), groups, miss=0.5)
    second = make_trials(np.random.default_rng(5), groups, miss=0.8)
    presses, a, b = paired_values("position_mean_mm", first, second)
    assert len(presses) == len(a) == len(b) < 40
    assert set(presses) == set(per_press("position_mean_mm", first)) & set(
        per_press("position_mean_mm", second)
    )


def test_a_better_model_is_told_from_a_worse_one(make_trials):
    groups = ["dual"] * 80
    good = make_trials(np.random.default_rng(5), groups, noise=0.2)
    bad = make_trials(np.random.default_rng(5), groups, noise=1.0)
    found = compare("gospa1_mm", good, bad, rng=np.random.default_rng(0))
    assert found.difference.high < 0
    assert found.p < 0.01
    same = compare("gospa1_mm", good, good, rng=np.random.default_rng(0))
    assert (same.difference.value, same.p) == (0, 1)


def test_plates_and_metrics_that_are_no_mean(singles):
    trials = PlateTrials(
        (PlatePose(1, 2),) * 3, (PlatePose(2, 2), None, PlatePose(4, 2)), [5, 5, 6]
    )
    assert per_press("depth_mae_mm", trials) == {5: 1.0, 6: 3.0}
    assert per_press("coverage", trials) == {5: 0.5, 6: 1.0}
    with pytest.raises(UserError, match="'r2' is no mean"):
        per_press("r2", singles)
