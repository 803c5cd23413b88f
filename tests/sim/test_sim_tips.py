"""Tips of other radii: what mechanics demands, and finite elements that made no table."""

from __future__ import annotations

import numpy as np
import pytest
from other_scenes import OTHER_TIPS

from tactibench import Indenter, Pose, Scene, SensorContext, UserError
from tactibench_sim import (
    TableMechanics,
    TacTip127,
    Tips,
    deepest_of,
    layout,
    shipped_dome,
    tip_tables,
)

PINS = layout(127)
EXACT_MM = 0.06


@pytest.fixture(scope="module")
def dome():
    return TableMechanics(shipped_dome(), "coupled", other_tips=True)


def tips(radius, *places):
    """One scene of tips (x, y, depth), mm."""
    at = np.array(places, dtype=float)
    return Tips(at[None, :, :2], at[None, :, 2], np.array([float(radius)]))


def bases(dome, scene):
    return dome.displacement(dome.loads(scene), PINS)[0]


def test_scenes_by_finite_elements_are_met(dome) -> None:
    worst: dict[float, float] = {}
    for scene in OTHER_TIPS:
        moved = dome.displacement(dome.loads(scene.as_tips), scene.directions)[0][0]
        error = float(np.linalg.norm(moved - scene.displacement, axis=1).max())
        worst[scene.radius] = max(worst.get(scene.radius, 0.0), error)
    assert set(worst) >= {1.0, 1.75, 6.0, 7.0}
    assert max(worst.values()) < EXACT_MM, worst


@pytest.mark.parametrize("radius", [1.0, 1.2, 1.5, 2.2, 2.9, 3.5, 5.0, 7.3, 8.0])
def test_a_tip_reaches_its_depth_and_its_force_grows(dome, radius) -> None:
    end = deepest_of(radius)
    depths = np.linspace(0.1, end, 7)
    table = tip_tables(radius).by_radius[radius]
    assert table.fields["w_outer"][:, 0] == pytest.approx(table.delta, abs=0.02)
    forces = [float(dome.forces(dome.loads(tips(radius, (0, 0, d))))[0, 0]) for d in depths]
    assert (np.diff(forces) > 0).all()
    if radius < 8.0:
        blunter = [
            float(dome.forces(dome.loads(tips(radius * 1.08, (0, 0, d))))[0, 0]) for d in depths
        ]
        assert (np.array(blunter) > forces).all()


def test_radii_beside_the_nominal_one_press_alike(dome) -> None:
    for places in (((2, 1, 2.0),), ((-3.5, 0, 2.0), (3.5, 0, 3.0))):
        nominal = bases(dome, tips(3.0, *places))
        for radius in (2.99, 3.01):
            assert abs(bases(dome, tips(radius, *places)) - nominal).max() < 0.02


def test_a_batch_of_many_radii_is_its_scenes_one_by_one(dome) -> None:
    rng = np.random.default_rng(1)
    radius = np.array([3.0, 1.0, 6.5, 3.0, 1.0, 2.3, np.inf])
    xy = np.where(np.isinf(radius)[:, None, None], 0.0, rng.uniform(-5, 5, (7, 2, 2)))
    depth = np.column_stack([rng.uniform(0.3, 1.4, 7), np.full(7, -np.inf)])
    depth[:4, 1] = 0.8
    together = bases(dome, Tips(xy, depth, radius))
    nominal = TableMechanics(shipped_dome(), "coupled")
    for k in range(7):
        alone = Tips(xy[k : k + 1], depth[k : k + 1], radius[k : k + 1])
        assert np.array_equal(together[k], bases(dome, alone)[0])
        if radius[k] in nominal.nominal.radii:
            assert np.array_equal(
                together[k], nominal.displacement(nominal.loads(alone), PINS)[0][0]
            )


@pytest.mark.parametrize(
    ("radius", "depth", "message"),
    [
        (0.9, 0.5, "1 to 8 mm"),
        (8.5, 0.5, "1 to 8 mm"),
        (1.0, 1.8, "tables end at 1.5 mm"),
        (2.0, 3.2, "tables end at 3 mm"),
        (6.0, 4.2, "tables end at 4 mm"),
    ],
)
def test_beyond_the_tables_is_refused(radius, depth, message) -> None:
    sensor = TacTip127(SensorContext(np.random.SeedSequence(1)))
    with pytest.raises(UserError, match=message):
        sensor.press(Scene(Indenter.single(radius), Pose(depth=depth)))
    assert sensor.press(Scene(Indenter.single(3.0), Pose(depth=depth))).image.any()
