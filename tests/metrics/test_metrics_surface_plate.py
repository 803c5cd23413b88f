"""The heatmap as a surface, and plate poses."""

import numpy as np
import pytest

from tactibench.contacts import Contacts, Grid, PlatePose
from tactibench.metrics import PlateTrials, Trials, surface_floor
from tactibench.metrics.registry import score

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


def test_excess_is_what_the_model_adds_to_the_floor():
    rng = np.random.default_rng(2)
    floor = rng.uniform(0.1, 0.3, 6)
    trials = surface_trials(rng, floor=floor)
    names = ["surface_rmse_mm", "surface_floor_mm", "surface_excess_mm"]
    rows = {(r.metric, r.group): r for r in score(names, trials, rng=np.random.default_rng(0))}
    for group, part in {"dual": slice(0, 2), "triple": slice(2, 5), "all": slice(0, 5)}.items():
        whole, least, excess = (rows[name, group] for name in names)
        assert least.value == pytest.approx(np.sqrt(floor[part].mean()))
        assert excess.value == pytest.approx(whole.value - least.value)
    excess = rows["surface_excess_mm", "all"]
    assert excess.low < excess.value < excess.high


def test_the_interval_of_the_excess_is_that_of_a_bootstrap_over_presses():
    rng = np.random.default_rng(4)
    n = 400
    maps = rng.uniform(0, 0.2, (n, 1, 1))
    floor = 0.25 * maps[:, 0, 0] ** 2 + rng.uniform(0, 0.02, n)
    none = (Contacts.none(),) * n
    trials = Trials(
        none, none, np.arange(n), ("all",) * n, maps=maps, surface=0 * maps, floor=floor
    )
    (row,) = score(["surface_excess_mm"], trials, rng=rng)
    picks = rng.integers(n, size=(4000, n))
    squares = (6 * maps[:, 0, 0]) ** 2
    drawn = np.sqrt(squares[picks].mean(axis=1)) - np.sqrt(floor[picks].mean(axis=1))
    assert (row.high - row.low) / 2 == pytest.approx(1.96 * drawn.std(), rel=0.06)


class Drawing:
    """An encoder that draws the depth of every contact in all cells."""

    def encode_batch(self, contacts, grid):
        depth = np.array([c.depth.sum() for c in contacts])
        return np.ones((len(contacts), 1, *grid.shape), np.float32) * depth[:, None, None, None] / 6


def test_the_floor_is_the_error_of_the_true_contacts_as_they_are_drawn():
    grid = Grid((2, 2), (0.0, 0.0), 1.0)
    truth = [Contacts.truth([[0, 0]], [depth]) for depth in np.linspace(1, 3, 250)]
    surfaces = np.zeros((250, 2, 2), np.float16)
    floor = surface_floor(Drawing(), truth, surfaces, grid, 6.0)
    assert floor == pytest.approx(np.linspace(1, 3, 250) ** 2, rel=1e-6)


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


@pytest.mark.parametrize("bad", [PlatePose(float("nan"), 0), PlatePose(1, float("inf"))])
def test_a_plate_that_is_not_finite_is_refused(bad):
    with pytest.raises(ValueError, match="not finite"):
        PlateTrials((PlatePose(1, 2),), (bad,), [0])
