"""Surfaces and bounds beside the frames: computed once, computed again when damaged."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from generated import open_frames
from stubs import StubSensor

from tactibench import Grid, SensorContext
from tactibench.contacts import Indenter, Pose, Scene
from tactibench.errors import UserError
from tactibench.frames import (
    D_PRIME,
    FALSELY_SEEN,
    PRESSES,
    SEEN,
    GeneratedFrameSet,
    sampled_limits,
    spacing_limit,
    true_bounds,
    true_surfaces,
)
from tactibench.geometry import tip_positions

GRID = Grid.centred(8, 0.4)
RequestOf = Callable[..., GeneratedFrameSet]


@pytest.fixture
def sensor(request_of: RequestOf) -> Any:
    return request_of().build(SensorContext(np.random.SeedSequence(0)))


def test_surfaces_are_kept(
    request_of: RequestOf, sensor: Any, counter: Any, tmp_path: Path
) -> None:
    presses = open_frames(request_of(), tmp_path)
    first = true_surfaces(sensor, presses, GRID)
    assert first is not None
    assert first.shape == (25, 8, 8)
    np.testing.assert_allclose(first[:, 0, 0], [s.pose.depth for s in presses.scenes], rtol=1e-3)
    again = true_surfaces(sensor, open_frames(request_of(), tmp_path), GRID)
    np.testing.assert_array_equal(first, again)
    assert counter.surfaces == 25
    for other in (Grid.centred(8, 0.5), Grid.centred(9, 0.4), Grid((8, 8), (0.0, 0.0), 0.4)):
        true_surfaces(sensor, presses, other)
    assert counter.surfaces == 100


def test_bounds_of_all_contacts_stand_in_one_array(
    request_of: RequestOf, sensor: Any, tmp_path: Path
) -> None:
    presses = open_frames(request_of(), tmp_path)
    for bounds in (true_bounds(sensor, presses), true_bounds(sensor, presses)):
        assert bounds is not None
        assert bounds.shape == (12 * (1 + 2) + 1, 3), "one and two contacts in turn"
        assert bounds[6, 0] == pytest.approx(1.04), "the first contact of the fifth press"


class Power(StubSensor):
    """D = (spacing / scale)^power; twice the noise with the nuisance "light"."""

    nuisances = ("light",)

    def __init__(self, scale: float = 1.0, power: float = 4.0) -> None:
        self.scale, self.power = scale, power

    def deviance(self, scene: Scene, nuisances: Sequence[str] = ()) -> Any:
        if scene.pose.x > 3:
            raise UserError("too far to the right.")
        first, second = tip_positions(scene)[:, :2]
        apart = float(np.linalg.norm(first - second))
        return (apart / self.scale) ** self.power / (4 if nuisances else 1)


SCENE = Scene(Indenter.dual(7.0), Pose(depth=1.0))


def test_an_observer_with_that_d_prime_sees_three_pairs_of_four() -> None:
    rng = np.random.default_rng(0)
    criterion = np.quantile(rng.normal(size=400_000), 1 - FALSELY_SEEN)
    hits = (rng.normal(D_PRIME, size=400_000) > criterion).mean()
    assert hits == pytest.approx(SEEN, abs=0.01)


@pytest.mark.parametrize("power", [2.0, 3.0, 4.0])
@pytest.mark.parametrize("scale", [0.02, 0.09, 0.5, 2.0])
def test_the_limit_of_a_power_law(scale: float, power: float) -> None:
    expected = scale * D_PRIME ** (2 / power)
    assert spacing_limit(Power(scale, power), SCENE) == pytest.approx(expected, rel=1e-4)
    noisy = spacing_limit(Power(scale, power), SCENE, ["light"])
    assert noisy == pytest.approx(expected * 4 ** (1 / power), rel=1e-4)


def test_without_any_difference_there_is_no_limit() -> None:
    assert spacing_limit(Power(1e6), SCENE) == np.inf
    assert spacing_limit(StubSensor(), SCENE) is None
    assert 0 < (spacing_limit(Power(1e-6), SCENE) or 0) <= 0.01


def test_a_few_pairs_are_asked_evenly_and_refused_ones_left_out() -> None:
    single = Scene(Indenter.single(), Pose(depth=1.0))
    pairs = [Scene(Indenter.dual(7.0), Pose(x, depth=1.0)) for x in np.linspace(0, 4, 200)]
    limits = sampled_limits(Power(), [single, *pairs])
    assert limits is not None
    assert limits.shape == (201,)
    asked = np.flatnonzero(~np.isnan(limits))
    assert 1 <= asked[0] <= 5
    assert len(asked) == pytest.approx(PRESSES * 3 / 4, abs=1)
    assert np.ptp(np.diff(asked)) <= 1
    few = sampled_limits(Power(), [single, *pairs[:3]])
    assert few is not None
    assert np.isnan(few).tolist() == [True, False, False, False]


def test_a_sensor_that_does_not_know_has_none() -> None:
    assert sampled_limits(StubSensor(), [SCENE]) is None
    nothing = sampled_limits(StubSensor(), [])
    assert nothing is not None
    assert not len(nothing)
