"""Contact forces: what the tables hold, and how several contacts share it."""

import numpy as np
import pytest

from tactibench import Contacts, Indenter, Pose, Scene, SensorContext
from tactibench.geometry import true_contacts
from tactibench_sim import PlanarGrid, TacTip127, shipped_dome

TABLE = shipped_dome().by_radius[3.0]
SINGLE = Indenter.single()


def sensor(kind=TacTip127, **parameters):
    return kind(SensorContext(np.random.SeedSequence(0)), **parameters)


@pytest.fixture(scope="module")
def tactip():
    return sensor()


def tips(*offsets):
    return Indenter(3.0, tuple(offsets), "custom")


def test_a_single_contact_at_a_node_carries_what_the_table_says(tactip):
    for node in (1, 4, 8, 24, 48):
        force = tactip.forces(Scene(SINGLE, Pose(depth=TABLE.delta[node])))
        assert force == pytest.approx([TABLE.fields["force"][node]], rel=1e-12)


def test_tips_at_one_place_carry_together_what_one_carries(tactip):
    one = tactip.forces(Scene(SINGLE, Pose(1, 2, 0, 0, 2.5)))
    for count in (2, 3):
        forces = tactip.forces(Scene(tips(*[(0, 0, 0)] * count), Pose(1, 2, 0, 0, 2.5)))
        assert len(forces) == count
        assert forces.sum() == pytest.approx(one[0], rel=1e-9)


@pytest.mark.parametrize("spacing", [16.0, 20.0, 24.0])
def test_far_tips_carry_what_each_carries_alone(tactip, spacing):
    """Up to 4 %, which is the work against the bulge that the other one raises."""
    both = tactip.forces(Scene(Indenter.dual(spacing), Pose(depth=2)))
    alone = tactip.forces(Scene(SINGLE, Pose(spacing / 2, 0, depth=_own_depth(spacing))))
    assert both[0] == pytest.approx(both[1], rel=1e-9)
    assert 1.0 <= both.sum() / (2 * alone[0]) < 1.04


def _own_depth(spacing):
    (depth, _) = true_contacts(Scene(Indenter.dual(spacing), Pose(depth=2))).depth
    return float(depth)


@pytest.mark.parametrize("indenter", [SINGLE, Indenter.dual(7), Indenter.triple((0, 0.5, 1))])
def test_the_whole_force_grows_with_depth(tactip, indenter):
    depths = np.linspace(0.05, 6.0, 40)
    whole = [tactip.forces(Scene(indenter, Pose(1, 0, 30, 0, d))).sum() for d in depths]
    assert (np.diff(whole) > 0).all()
    assert whole[0] < 0.02


def test_forces_are_in_the_order_of_the_true_contacts(tactip):
    scene = Scene(tips((-4, 0, 0), (4, 0, 0.8), (0, 6, -9)), Pose(depth=2))
    contacts: Contacts = true_contacts(scene)
    forces = tactip.forces(scene)
    assert len(forces) == len(contacts) == 2
    assert (np.argsort(forces) == np.argsort(contacts.depth)).all()
    assert tactip.forces(Scene(SINGLE, Pose())).shape == (0,)


def test_where_forces_are_not_known():
    scene = Scene(SINGLE, Pose(depth=1))
    assert sensor(PlanarGrid).forces(scene) is None
