"""Tier auto: its bounds hold, and it takes what they say."""

from dataclasses import replace

import numpy as np
import pytest

from tactibench import Indenter, Pose, Scene, SensorContext
from tactibench_sim import reference
from tactibench_sim.auto import AutoMechanics
from tactibench_sim.bounds import bounds_for
from tactibench_sim.contact import Tips
from tactibench_sim.field import Mechanics
from tactibench_sim.sensor import TacTip127
from tactibench_sim.table import shipped

TABLES = shipped()
AUTO = AutoMechanics(TABLES)
SCENES = reference.shipped()


def tips(scene):
    return Tips(scene.tips[None, :, :2], scene.tips[None, :, 2], np.array([3.0]))


def three(distance, depth):
    """One scene of two equal tips beside the apex."""
    half = distance / 2
    return Tips(np.array([[[-half, 0.0], [half, 0.0]]]), np.full((1, 2), depth), np.array([3.0]))


def test_the_bounds_that_ship_are_of_the_tables_that_ship():
    assert bounds_for(TABLES.digest) is not None
    assert bounds_for("another") is None


@pytest.mark.parametrize("tier", ["superpose", "coupled"])
def test_no_reference_scene_is_worse_than_its_bound(tier):
    mechanics = Mechanics(TABLES, tier)
    for scene in SCENES:
        n, delta, table = AUTO.touching(tips(scene))
        cheap, dear = AUTO._bounds(n, delta, table)
        u, _ = mechanics.displacement(mechanics.loads(tips(scene)), scene.directions)
        error = np.linalg.norm(u[0] - scene.displacement, axis=1).max()
        assert error <= (cheap if tier == "superpose" else dear)[0] + 2e-3, scene.name


@pytest.mark.parametrize("tolerance", [0.02, 0.1, 0.3])
def test_every_scene_takes_the_cheapest_tier_that_is_good_enough(tolerance):
    auto = AutoMechanics(TABLES, tolerance)
    plain = {tier: Mechanics(TABLES, tier) for tier in ("superpose", "coupled")}
    for scene in SCENES[::3]:
        taken = auto.taken(tips(scene))
        tier = max(("superpose", "coupled"), key=lambda name: taken[name])
        assert taken[tier] == 1
        cheap, dear = auto._bounds(*auto.touching(tips(scene)))
        if cheap[0] <= tolerance:
            assert tier == "superpose"
        assert taken["tolerance_unmet"] == (min(cheap[0], dear[0]) > tolerance)
        field = auto.displacement(auto.loads(tips(scene)), scene.directions)[0]
        same = plain[tier].displacement(plain[tier].loads(tips(scene)), scene.directions)[0]
        assert (field == same).all()


def test_far_tips_are_added_and_near_ones_coupled():
    assert AUTO.taken(three(16.0, 0.5))["superpose"] == 1
    assert AUTO.taken(three(7.0, 2.0))["coupled"] == 1
    assert AUTO.taken(three(0.0, 2.0))["coupled"] == 1


def test_without_bounds_several_contacts_are_coupled_and_counted_as_unmet():
    auto = AutoMechanics(replace(TABLES, digest="another"))
    assert auto.taken(three(7.0, 0.1)) == {
        "superpose": 0,
        "coupled": 1,
        "fem": 0,
        "tolerance_unmet": 1,
    }


def test_a_sensor_tells_how_many_scenes_took_which_tier():
    scenes = [
        Scene(Indenter.single(), Pose(depth=1.0)),
        Scene(Indenter.dual(7.0), Pose(depth=2.0)),
        Scene(Indenter.dual(7.0), Pose(depth=6.4)),
    ]
    context = SensorContext(np.random.SeedSequence(0))
    told = TacTip127(context, tier="auto").scene_counts(scenes)
    assert told == {"superpose": 1, "coupled": 2, "fem": 0, "tolerance_unmet": 1}
    assert TacTip127(context, tier="coupled").scene_counts(scenes) == {}
