"""A metric press by press."""

import numpy as np
import pytest

from tactibench import UserError
from tactibench.contacts import PlatePose
from tactibench.metrics import PlateTrials, press_means, press_shares


def test_values_are_means_of_each_press(kinds):
    means = press_means("spurious", kinds, ("triple",))[:, 0]
    extra = np.array(
        [len(p) - int((kinds.matched.trial == i).sum()) for i, p in enumerate(kinds.predictions)]
    )
    presses = np.unique(kinds.press)
    assert np.isfinite(means).sum() == 30
    for press, value in zip(presses[np.isfinite(means)], means[np.isfinite(means)], strict=True):
        assert value == pytest.approx(extra[kinds.press == press].mean())


def test_shares_of_presses_with_few_and_many_frames_have_the_metric_as_their_mean():
    plates = [PlatePose(depth, 0) for depth in (1, 2, 3, 4, 5)]
    answers = [PlatePose(depth, 0) for depth in (2, 4, 6, 8, 5)]  # off by 1, 2, 3, 4, 0
    trials = PlateTrials(tuple(plates), tuple(answers), [5, 5, 5, 5, 6])
    assert press_means("depth_mae_mm", trials)[:, 0].tolist() == [2.5, 0.0]
    shares = press_shares("depth_mae_mm", trials)
    assert shares.tolist() == [4.0, 0.0]  # 10 mm of four frames and 0 of one; 2.5 a press
    assert shares.mean() == np.mean([1, 2, 3, 4, 0])
    equal = PlateTrials(tuple(plates[:4]), tuple(answers[:4]), [5, 5, 6, 6])
    assert (press_shares("depth_mae_mm", equal) == press_means("depth_mae_mm", equal)[:, 0]).all()
    none = PlateTrials((plates[0],), (None,), [5])
    assert np.isnan(press_shares("depth_mae_mm", none)).all()


def test_plates_and_metrics_that_are_no_mean(singles):
    trials = PlateTrials(
        (PlatePose(1, 2),) * 3, (PlatePose(2, 2), None, PlatePose(4, 2)), [5, 5, 6]
    )
    assert press_means("depth_mae_mm", trials)[:, 0].tolist() == [1.0, 3.0]
    assert press_means("coverage", trials)[:, 0].tolist() == [0.5, 1.0]
    with pytest.raises(UserError, match="'r2' cannot be computed press by press"):
        press_means("r2", singles)
