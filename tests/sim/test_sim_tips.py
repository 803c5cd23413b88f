"""Tips of other radii: what mechanics demands, and finite elements that made no table."""

from __future__ import annotations

import numpy as np
import pytest

from tactibench import Indenter, Pose, Scene, SensorContext, UserError
from tactibench_sim.mechanics import tables
from tactibench_sim.mechanics.contact import Tips
from tactibench_sim.mechanics.dome import TableMechanics
from tactibench_sim.mechanics.tip_tables import deepest, shipped
from tactibench_sim.mechanics.tips import TipMechanics
from tactibench_sim.pins import layout
from tactibench_sim.reference_frames import scenes as reference
from tactibench_sim.sensor import TacTip127

PINS = layout(127)
EXACT_MM = 0.06


@pytest.fixture(scope="module")
def dome():
    return TipMechanics(TableMechanics(tables.shipped(), "coupled"))


def tips(radius, *places):
    """One scene of tips (x, y, depth), mm."""
    at = np.array(places, dtype=float)
    return Tips(at[None, :, :2], at[None, :, 2], np.array([float(radius)]))


def bases(dome, scene):
    return dome.displacement(dome.loads(scene), PINS)[0]


def test_scenes_by_finite_elements_are_met(dome) -> None:
    worst: dict[float, float] = {}
    for scene in reference.shipped_other_tips().scenes:
        moved = dome.displacement(dome.loads(scene.as_tips), scene.directions)[0][0]
        error = float(np.linalg.norm(moved - scene.displacement, axis=1).max())
        worst[scene.radius] = max(worst.get(scene.radius, 0.0), error)
    assert set(worst) >= {1.0, 1.75, 6.0, 7.0}
    assert max(worst.values()) < EXACT_MM, worst


@pytest.mark.parametrize("radius", [1.0, 1.2, 1.5, 2.2, 2.9, 3.5, 5.0, 7.3, 8.0])
def test_a_tip_reaches_its_depth_and_its_force_grows(dome, radius) -> None:
    end = deepest(radius)
    depths = np.linspace(0.1, end, 7)
    table = shipped().tables(radius).by_radius[radius]
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
    nominal = TableMechanics(tables.shipped(), "coupled")
    for k in range(7):
        alone = Tips(xy[k : k + 1], depth[k : k + 1], radius[k : k + 1])
        assert np.array_equal(together[k], bases(dome, alone)[0])
        if radius[k] in nominal.radii:
            assert np.array_equal(
                together[k], nominal.displacement(nominal.loads(alone), PINS)[0][0]
            )


def test_exchanging_the_tips_of_a_pair_changes_nothing(dome) -> None:
    for radius in (1.0, 1.4, 4.0):
        one = bases(dome, tips(radius, (-2, 0.5, 1.2), (2, 0, 0.7)))
        two = bases(dome, tips(radius, (2, 0, 0.7), (-2, 0.5, 1.2)))
        assert one == pytest.approx(two, abs=1e-12)


def test_the_same_press_turned_about_the_axis(dome) -> None:
    angle = np.radians(60.0)  # the hexagon of pins is turned onto itself
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    places = np.array([[4.0, 1.0], [1.0, -1.0]])
    plain = bases(dome, tips(1.5, *np.column_stack([places, [1.5, 1.0]])))[0]
    turned = bases(dome, tips(1.5, *np.column_stack([places @ turn.T, [1.5, 1.0]])))[0]
    assert np.sort(np.linalg.norm(turned, axis=1)) == pytest.approx(
        np.sort(np.linalg.norm(plain, axis=1)), abs=1e-6
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


@pytest.mark.slow
def test_a_stored_scene_comes_out_of_the_finite_elements_again() -> None:
    pytest.importorskip("ngsolve")
    from tactibench_sim import fem
    from tactibench_sim.fem.press import SpatialPress
    from tactibench_sim.fem.tip import Tip

    scenes = reference.shipped_other_tips().scenes
    scene = next(one for one in scenes if one.radius == 1.75)
    tips = [Tip.downwards(fem.Dome(), *place, 1.75) for place in scene.tips[:, :2]]
    press = SpatialPress(fem.Dome(), tips, scene.tips[None, :, 2])
    press.move(scene.tips[:, 2])
    assert press.field().inner(PINS) == pytest.approx(scene.displacement, abs=0.01)
