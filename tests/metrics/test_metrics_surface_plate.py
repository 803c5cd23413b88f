"""The heatmap as a surface, and plate poses."""

import numpy as np
import pytest

from tactibench.contacts import Contacts, PlatePose
from tactibench.metrics.score import score
from tactibench.metrics.trials import PlateTrials, Trials

PLATE = ["depth_mae_mm", "tilt_mae_deg", "coverage"]


def surface_trials(rng, **options):
    maps = rng.random((6, 5, 4)).astype(np.float32)
    surface = rng.uniform(0, 6, (6, 5, 4))
    group = ("dual", "dual", "triple", "triple", "triple", "catch")
    none = (Contacts.none(),) * 6
    return Trials(none, none, [0, 0, 1, 1, 2, 3], group, maps=maps, surface=surface, **options)


def test_surface_rmse_pools_cells_and_frames():
    trials = surface_trials(np.random.default_rng(0), max_depth=4.0)
    rows = score(["surface_rmse_mm"], trials, rng=np.random.default_rng(0))
    error = (trials.maps.astype(float) * 4 - trials.surface) ** 2
    parts = {"dual": slice(0, 2), "triple": slice(2, 5), "all": slice(0, 5)}
    assert {r.group for r in rows} == set(parts)
    for row in rows:
        assert row.value == pytest.approx(np.sqrt(error[parts[row.group]].mean()))
    assert rows[0].low is None  # both frames are of one press


def test_a_constant_offset_is_its_rmse():
    maps = np.full((3, 8, 8), 0.5)
    none = (Contacts.none(),) * 3
    trials = Trials(none, none, np.arange(3), ("all",) * 3, maps=maps, surface=maps * 6 + 0.25)
    (row,) = score(["surface_rmse_mm"], trials, rng=np.random.default_rng(0))
    assert (row.value, row.low, row.high) == pytest.approx((0.25, 0.25, 0.25))


def test_plates_against_plain_loops():
    rng = np.random.default_rng(1)
    truth = tuple(PlatePose(*rng.uniform([0, -20], [6, 20])) for _ in range(60))
    guess = tuple(
        PlatePose(t.depth + rng.normal(0, 0.1), t.tilt + rng.normal())
        if rng.random() < 0.8
        else None
        for t in truth
    )
    press = np.arange(60) // 3
    rows = {
        r.metric: r
        for r in score(PLATE, PlateTrials(truth, guess, press), rng=np.random.default_rng(0))
    }
    both = [(t, p) for t, p in zip(truth, guess, strict=True) if p]
    assert rows["depth_mae_mm"].value == pytest.approx(
        np.mean([abs(t.depth - p.depth) for t, p in both])
    )
    assert rows["tilt_mae_deg"].value == pytest.approx(
        np.mean([abs(t.tilt - p.tilt) for t, p in both])
    )
    assert rows["coverage"].value == pytest.approx(len(both) / 60)
    assert (rows["tilt_mae_deg"].n, rows["coverage"].n, rows["coverage"].clusters) == (
        len(both),
        60,
        20,
    )


def test_plates_without_answers():
    trials = PlateTrials((PlatePose(1, 2),) * 4, (None,) * 4, np.arange(4))
    rows = {r.metric: r for r in score(PLATE, trials, rng=np.random.default_rng(0))}
    assert rows["coverage"].value == 0
    assert rows["coverage"].high > 0.2
    assert (rows["tilt_mae_deg"].value, rows["tilt_mae_deg"].n) == (None, 0)


@pytest.mark.parametrize("bad", [PlatePose(float("nan"), 0), PlatePose(1, float("inf"))])
def test_a_plate_that_is_not_finite_is_refused(bad):
    with pytest.raises(ValueError, match="not finite"):
        PlateTrials((PlatePose(1, 2),), (bad,), [0])
    with pytest.raises(ValueError, match="no truth"):
        PlateTrials((None,), (PlatePose(1, 2),), [0])
