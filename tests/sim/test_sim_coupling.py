"""Load sharing: complementarity and its limits."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactibench_sim.mechanics.contact import Tips
from tactibench_sim.mechanics.corrections import Corrections
from tactibench_sim.mechanics.dome import TableMechanics
from tactibench_sim.mechanics.tables import shipped
from tactibench_sim.pins import layout

COUPLED, SUPERPOSE = TableMechanics(shipped(), "coupled"), TableMechanics(shipped(), "superpose")
BARE = TableMechanics(replace(shipped(), corrections=Corrections()), "coupled")
PINS = layout(127)
SKIN = layout(331)


def tips(*contacts, radius=3.0):
    """One scene of (x, y, depth)."""
    array = np.array([contacts], dtype=float)
    return Tips(array[..., :2], array[..., 2], np.array([radius]))


def pins(mechanics, *contacts):
    return mechanics.pin_tips(mechanics.loads(tips(*contacts)), PINS, 2.0)[0]


contact = st.tuples(st.floats(-6, 6), st.floats(-6, 6), st.floats(0.01, 5))


@given(st.lists(contact, min_size=2, max_size=6))
def test_every_tip_reaches_its_depth_or_stands_clear(contacts):
    """Without the corrections, which also move the skin sideways under a tip."""
    scene = tips(*contacts)
    loads = BARE.loads(scene)
    n, delta = scene.directions()
    skin = BARE.skin(loads, n[0])[0]
    assert (loads.amplitude >= 0).all()
    assert (skin >= delta[0] - 0.004).all()  # the table's own contact stiffness
    carrying = loads.amplitude[0] > 1e-6
    assert skin[carrying] == pytest.approx(delta[0][carrying], abs=0.004)


@pytest.mark.parametrize("depth", [0.5, 2.0, 6.0])
def test_two_identical_tips_are_one(depth):
    one = pins(COUPLED, (2.0, 1.0, depth))
    for count in (2, 3, 6):
        assert pins(COUPLED, *[(2.0, 1.0, depth)] * count) == pytest.approx(one, abs=1e-8)
    assert abs(pins(SUPERPOSE, (2.0, 1.0, depth), (2.0, 1.0, depth)) - one).max() > 0.1


def test_nearly_identical_tips_are_nearly_one():
    one = pins(COUPLED, (0.0, 0.0, 3.0))
    for gap in (1e-1, 1e-2, 1e-4, 1e-6):
        two = pins(COUPLED, (-gap / 2, 0.0, 3.0), (gap / 2, 0.0, 3.0))
        assert abs(two - one).max() < 0.5 * gap + 1e-8


def test_spacing_is_continuous():
    """0 to 2 R at fixed depth: no jump larger than the step explains."""
    gaps = np.arange(0.0, 6.0, 0.02)
    track = np.array([pins(COUPLED, (-g / 2, 0.3, 4.0), (g / 2, 0.3, 4.0)) for g in gaps])
    assert abs(np.diff(track, axis=0)).max() < 0.05


def test_far_tips_do_not_share():
    far = tips((-11.0, 0.0, 1.0), (11.0, 0.0, 1.0))
    assert COUPLED.loads(far).amplitude[0] == pytest.approx([1, 1], abs=0.03)


def test_neighbours_share():
    near = COUPLED.loads(tips((-3.25, 0.0, 3.0), (3.25, 0.0, 3.0)))
    assert near.amplitude[0, 0] == pytest.approx(near.amplitude[0, 1], abs=1e-12)
    assert 0.5 < near.amplitude[0, 0] < 0.95


def test_a_tip_in_anothers_dimple_carries_nothing():
    alone = pins(COUPLED, (0.0, 0.0, 4.0))
    both = tips((0.0, 0.0, 4.0), (1.5, 0.0, 0.3))
    assert COUPLED.loads(both).amplitude[0, 1] == 0
    assert (pins(COUPLED, (0.0, 0.0, 4.0), (1.5, 0.0, 0.3)) == alone).all()


def test_a_tip_beside_anothers_bulge_carries_more_and_starts_smoothly():
    def second(depth):
        return COUPLED.loads(tips((-7.0, 0.0, 6.0), (8.5, 0.0, depth)))

    amplitude = second(0.5).amplitude[0, 1] * second(0.5).shape[0, 1]
    assert amplitude > 0.5
    depths = np.arange(-0.5, 0.5, 0.005)
    track = np.array([pins(COUPLED, (-7.0, 0.0, 6.0), (8.5, 0.0, d)) for d in depths])
    assert abs(np.diff(track, axis=0)).max() < 0.03


@given(st.lists(contact, min_size=2, max_size=4), st.randoms(use_true_random=False))
def test_the_order_of_tips_does_not_matter(contacts, random):
    other = list(contacts)
    random.shuffle(other)
    assert pins(COUPLED, *other) == pytest.approx(pins(COUPLED, *contacts), abs=1e-7)


def test_superposition_is_the_sum():
    a, b = (-3.0, 1.0, 2.0), (4.0, 0.0, 3.0)
    u = [SUPERPOSE.displacement(SUPERPOSE.loads(tips(*c)), PINS)[0] for c in ((a, b), (a,), (b,))]
    assert u[0] == pytest.approx(u[1] + u[2], abs=1e-14)
