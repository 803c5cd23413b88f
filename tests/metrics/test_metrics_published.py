"""The paired comparison with answers that somebody released."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from tactibench import PlatePose
from tactibench.metrics import PUBLISHED_NAMES, PlateTrials
from tactibench.metrics.registry import score


def plates(depth, tilt):
    return tuple(PlatePose(float(d), float(t)) for d, t in zip(depth, tilt, strict=True))


def drawn(count=300, seed=0):
    rng = np.random.default_rng(seed)
    true = rng.normal(size=(2, count))
    ours = true + rng.normal(size=(2, count)) * [[0.02], [0.5]]
    theirs = true + rng.normal(size=(2, count)) * [[0.06], [1.0]]
    return true, ours, theirs


def scored(trials):
    rows = score(PUBLISHED_NAMES, trials, rng=np.random.default_rng(1))
    return {(row.metric, row.group): row for row in rows}


def test_the_difference_is_a_paired_t_interval():
    true, ours, theirs = drawn()
    trials = PlateTrials(
        plates(*true), plates(*ours), np.arange(300), published={"paper": plates(*theirs)}
    )
    found = scored(trials)
    for k, name in enumerate(("depth_mae_minus_published_mm", "tilt_mae_minus_published_deg")):
        d = np.abs(ours[k] - true[k]) - np.abs(theirs[k] - true[k])
        half = stats.sem(d) * stats.t.ppf(0.975, 299)
        row = found[name, "paper"]
        assert (row.value, row.low, row.high) == pytest.approx(
            (d.mean(), d.mean() - half, d.mean() + half)
        )
        assert (row.n, row.clusters, row.better) == (300, 300, "lower")
        assert row.high < 0
    assert found["depth_mae_minus_published_p", "paper"].value == 1e-4


def test_only_frames_that_both_answered_count_and_presses_stay_whole():
    true, ours, theirs = drawn(40)
    mine, other = list(plates(*ours)), list(plates(*theirs))
    mine[3] = other[5] = None
    trials = PlateTrials(
        plates(*true), tuple(mine), np.arange(40) // 2, published={"paper": tuple(other)}
    )
    row = scored(trials)["depth_mae_minus_published_mm", "paper"]
    keep = np.setdiff1d(np.arange(40), [3, 5])
    d = (np.abs(ours[0] - true[0]) - np.abs(theirs[0] - true[0]))[keep]
    assert row.value == pytest.approx(d.mean())
    assert (row.n, row.clusters) == (38, 20)


def test_equal_answers_differ_by_nothing_for_sure():
    true, ours, _ = drawn(30)
    trials = PlateTrials(
        plates(*true), plates(*ours), np.arange(30), published={"paper": plates(*ours)}
    )
    found = scored(trials)
    assert found["tilt_mae_minus_published_deg", "paper"].value == 0.0
    assert found["tilt_mae_minus_published_p", "paper"].value == 1.0


def test_without_released_answers_there_are_no_rows():
    true, ours, _ = drawn(5)
    assert scored(PlateTrials(plates(*true), plates(*ours), np.arange(5))) == {}


def test_released_answers_must_be_one_a_frame():
    true, ours, _ = drawn(5)
    with pytest.raises(ValueError, match="paper has 4 entries for 5"):
        PlateTrials(
            plates(*true), plates(*ours), np.arange(5), published={"paper": plates(*ours)[:4]}
        )
