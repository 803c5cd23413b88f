"""A common view of sensors with different pins: fields carried over exactly, and nearly."""

from __future__ import annotations

import numpy as np
import pytest
from drawn_pins import hexagon
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import UserError
from tactibench.markers import REACH, Outline, common_lattice, common_view, kriging_weights

RING = np.array(
    [
        (k * np.cos(a), k * np.sin(a)) if k else (0.0, 0.0)
        for k in range(11)
        for a in 2 * np.pi * np.arange(max(1, 6 * k)) / max(1, 6 * k)
    ]
)
"""331 pins in ten rings, radius 10."""


def dimple(places):
    """(P, 2) units: pins flee from a contact, as under a plate."""
    away = places - [0.1, -0.2]
    return 0.1 * away * np.exp(-(away**2).sum(axis=1, keepdims=True) / (2 * 0.4**2))


def packed(field):
    return field.T.reshape(1, -1)


def test_the_lattice_is_rings_around_the_centre():
    points = common_lattice()
    assert points.shape == (127, 2)
    np.testing.assert_allclose(points.mean(axis=0), 0, atol=1e-12)
    assert np.hypot(*points.T).max() == pytest.approx(REACH)


@given(st.floats(0.7, 1.4), st.floats(20, 200), st.floats(-50, 50))
def test_an_outline_undoes_an_uneven_resize(uneven, size, shift):
    stretched = RING * [size, uneven * size] + shift
    found = Outline.of(stretched)
    np.testing.assert_allclose(found.centre, shift, atol=1e-6 * size)
    np.testing.assert_allclose(found.scale, [10 * size, 10 * uneven * size], rtol=1e-9)


def test_a_hexagon_and_rings_of_one_size_have_one_outline():
    hexagonal = hexagon(6, 10 / 6, 0.0)
    np.testing.assert_allclose(Outline.of(hexagonal).scale, Outline.of(RING).scale, rtol=1e-9)


@settings(max_examples=20)
@given(st.lists(st.floats(-1, 1), min_size=6, max_size=6))
def test_linear_fields_are_carried_exactly(slope):
    points = common_lattice()
    matrix, shift = np.array(slope[:4]).reshape(2, 2), np.array(slope[4:])
    weights = kriging_weights(RING / 10, points)
    found = weights @ (RING / 10 @ matrix + shift)
    np.testing.assert_allclose(found, points @ matrix + shift, atol=1e-9)


@pytest.mark.parametrize("lost", [0, 12])
def test_two_layouts_give_one_view_also_without_some_pins(lost):
    points = common_lattice()
    found = []
    for layout, px in ((RING, 13.0), (hexagon(6, 10 / 6, 0.0), 9.0)):
        keep = np.random.default_rng(0).permutation(len(layout))[lost:]
        keep = np.union1d(keep, np.argsort(np.hypot(*layout.T))[-6:])
        rest = layout[np.sort(keep)] * px + [180, 130]
        moved = 10 * px * dimple((rest - [180, 130]) / (10 * px))
        found.append(common_view(rest, points)(packed(moved)))
    np.testing.assert_allclose(found[0], found[1], atol=0.004)  # of a field of 0.024
    if not lost:
        np.testing.assert_allclose(found[0], packed(dimple(points)), atol=0.001)


def test_pins_on_a_line_and_too_few_are_refused():
    for rest in (np.column_stack([np.arange(9.0), np.zeros(9)]), RING[:6]):
        with pytest.raises(UserError, match="outline"):
            Outline.of(rest)
