"""Tier green: complementarity, symmetry, limits, and the finite-element table of one contact."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from tactibench import UserError
from tactibench_sim.green import kernel as kernels
from tactibench_sim.green.complementarity import solve
from tactibench_sim.green.mechanics import GreenMechanics
from tactibench_sim.mechanics.contact import Tips
from tactibench_sim.mechanics.tables import shipped
from tactibench_sim.pins import layout

DOME = GreenMechanics(kernels.shipped())
PINS = layout(127)
POLAR = np.radians(np.arange(2, 70, 1.0))
MERIDIAN = np.stack([np.sin(POLAR), 0 * POLAR, np.cos(POLAR)], axis=1)


def loads(contacts, radius=3.0):
    array = np.array([contacts], dtype=float)
    return DOME.loads(Tips(array[..., :2], array[..., 2], np.array([radius])))


def moved(contacts, directions=PINS, radius=3.0):
    return DOME.displacement(loads(contacts, radius), directions)[0][0]


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40))
def test_complementarity(seed, count):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(count, count))
    a, d = root @ root.T + 0.1 * np.eye(count), rng.normal(size=count)
    force, fine = solve(a, d, rng.random(count) < 0.5)
    gap = a @ force - d
    assert fine
    assert force.min() >= 0
    assert gap.min() > -1e-9
    assert abs(force * gap).max() < 1e-8
    lower = np.linalg.cholesky(a)  # independent: the same problem as least squares
    assert force == pytest.approx(nnls(lower.T, np.linalg.solve(lower, d))[0], abs=1e-7)


def test_complementarity_refuses_what_is_not_positive():
    assert not solve(-np.eye(2), np.ones(2), np.ones(2, dtype=bool))[1]


def test_far_tips_superpose():
    pair = [(-12.0, 0.0, 0.5), (12.0, 0.0, 0.5)]
    assert moved(pair) == pytest.approx(sum(moved([p]) for p in pair), abs=0.01)


@pytest.mark.parametrize("radius", [1.0, 3.0, math.inf])
def test_force_grows_with_depth(radius):
    force = DOME.shape(radius).force
    assert (np.diff(force) > 0).all()


@pytest.mark.parametrize(("depth", "most"), [(0.5, 0.01), (1.0, 0.02), (2.0, 0.05)])
def test_one_sphere_agrees_with_the_finite_elements(depth, most):
    table = shipped().by_radius[3.0]
    u = moved([(0.0, 0.0, depth)], MERIDIAN)
    inward = -(u * MERIDIAN).sum(axis=1)
    row = table.fields["w"][round(depth / table.delta[1])]
    expected = np.interp(POLAR, table.polar, row)
    assert abs(inward - expected).max() < most
    force = loads([(0.0, 0.0, depth)])[0].force[0]
    told = table.fields["force"][round(depth / table.delta[1])]
    assert force == pytest.approx(told, rel=0.04)


def test_tables_replace_single_contacts():
    table = shipped()
    dome = GreenMechanics(kernels.shipped(), table)
    tips = Tips(np.zeros((1, 1, 2)), np.full((1, 1), 2.0), np.array([3.0]))
    u = dome.displacement(dome.loads(tips), MERIDIAN)[0][0]
    row = table.by_radius[3.0].fields["w"][16]
    expected = np.interp(POLAR, table.by_radius[3.0].polar, row)
    assert -(u * MERIDIAN).sum(axis=1) == pytest.approx(expected, abs=1e-3)


def test_the_derivative_is_that_of_the_displacement():
    pressing = loads([(-3.0, 1.0, 2.0), (3.0, 0.0, 1.5)])
    _, slope = DOME.displacement(pressing, PINS)
    rng, step = np.random.default_rng(0), 1e-5
    tangent = np.cross(PINS, rng.normal(size=PINS.shape))
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    ends = [
        DOME.displacement(pressing, PINS * math.cos(s) + tangent * math.sin(s))[0][0]
        for s in (-step, step)
    ]
    numeric = (ends[1] - ends[0]) / (2 * step)
    assert np.einsum("pij,pj->pi", slope[0], tangent) == pytest.approx(numeric, abs=2e-4)


def test_normals_of_the_undeformed_dome_and_under_a_tip():
    rest, pressed = loads([(0.0, 0.0, 0.0)]), loads([(0.0, 0.0, 1.0)])
    assert DOME.normals(rest, PINS)[1][0] == pytest.approx(PINS, abs=1e-14)
    _, normal = DOME.normals(pressed, MERIDIAN)
    turn = np.arcsin((normal[0] * np.stack([np.cos(POLAR), 0 * POLAR, -np.sin(POLAR)], 1)).sum(1))
    table = shipped().by_radius[3.0]
    expected = np.interp(POLAR, table.polar, table.fields["omega"][8])
    # tables turn towards the contact's outside with omega = (w' + t) / r, w inwards
    assert turn == pytest.approx(expected, abs=0.03)


@pytest.mark.parametrize(
    ("contact", "radius", "words"),
    [
        ((0.0, 0.0, 7.0), 3.0, "penetrates 7.00 mm"),
        ((19.0, 0.0, 0.5), 3.0, "deg from the apex"),
        ((0.0, 0.0, 1.0), 0.5, "radius is 0.5 mm"),
        ((0.0, 0.0, 1.0), math.nan, "not a number"),
    ],
)
def test_refused(contact, radius, words):
    with pytest.raises(UserError, match=words):
        loads([contact], radius)
