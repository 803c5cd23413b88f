"""The vocabulary: what contacts and grids promise."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactibench import Contacts, Grid, Indenter

finite = st.floats(-1e3, 1e3)
counts = st.integers(0, 7)
grids = st.builds(
    Grid,
    st.tuples(st.integers(1, 90), st.integers(1, 90)),
    st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
    st.floats(0.05, 5),
)


@st.composite
def tables(draw):
    n = draw(counts)
    return (
        draw(arrays(np.float64, (n, 2), elements=finite)),
        draw(arrays(np.float64, n, elements=finite)),
        draw(arrays(np.float64, n, elements=st.sampled_from([0.0, 0.2, 0.5, 0.9, 1.0]))),
        draw(arrays(np.float64, (n, 3), elements=st.floats(0, 5))),
    )


@given(tables())
def test_contacts_are_sorted_by_score_and_rows_stay_together(table):
    xy, depth, score, std = table
    contacts = Contacts(xy, depth, score, std)
    rows = zip(score.tolist(), xy.tolist(), depth.tolist(), std.tolist(), strict=True)
    expected = sorted(rows, key=lambda row: -row[0])  # stable: equal scores keep their order
    assert len(contacts) == len(depth)
    found = zip(
        contacts.score.tolist(),
        contacts.xy.tolist(),
        contacts.depth.tolist(),
        contacts.std.tolist(),
        strict=True,
    )
    assert list(found) == expected
    assert np.array_equal(Contacts(xy, depth, score, None, std).force, contacts.std)


@given(tables(), counts)
def test_top_takes_the_best(table, count):
    contacts = Contacts(*table, force=-table[3])
    top = contacts.top(count)
    assert len(top) == min(count, len(contacts))
    for name in ("xy", "depth", "score", "std", "force"):
        np.testing.assert_array_equal(getattr(top, name), getattr(contacts, name)[:count])
    assert Contacts(*table[:3]).top(count).std is None


def test_contacts_are_a_copy_and_cannot_be_changed():
    xy = np.array([[1.0, 2.0]])
    contacts = Contacts.truth(xy, [3.0])
    xy[0, 0] = 9.0
    assert contacts.xy[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        contacts.xy[0, 0] = 9.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        contacts.depth = np.zeros(1)


@pytest.mark.parametrize(
    ("xy", "depth", "score", "std", "says"),
    [
        ([[0, 0, 0]], [1], [1], None, "xy"),
        ([[0, 0], [1, 1]], [1], [1], None, "xy"),
        ([[0, 0]], [1], [1, 1], None, "score"),
        ([[0, 0]], [1], [1], [[1, 1]], "std"),
        ([[0, math.nan]], [1], [1], None, "xy"),
        ([[0, 0]], [math.inf], [1], None, "depth"),
        ([[0, 0]], [1], [math.nan], None, "score"),
        ([[0, 0]], [1], [1], [[0, 0, math.nan]], "std"),
        ([[0, 0]], [1], [1.01], None, "score"),
        ([[0, 0]], [1], [-0.01], None, "score"),
    ],
)
def test_contacts_that_make_no_sense_are_refused(xy, depth, score, std, says):
    with pytest.raises(ValueError, match=says):
        Contacts(np.array(xy), np.array(depth), np.array(score), std)


def test_true_contacts_take_one_force_each():
    assert Contacts.truth([[0, 0]], [1]).force is None
    assert Contacts.truth([[0, 0]], [1], [[0, 1, -2]]).force.tolist() == [[0, 1, -2]]
    with pytest.raises(ValueError, match="force"):
        Contacts.truth([[0, 0]], [1], [[0, 1, -2], [0, 0, 0]])


@given(grids, st.floats(-100, 100), st.floats(-100, 100))
def test_cells_to_millimetres_and_back(grid, row, column):
    back_row, back_column = grid.cells(grid.xy(row, column))
    assert back_row == pytest.approx(row, abs=1e-9)
    assert back_column == pytest.approx(column, abs=1e-9)


@given(grids, arrays(np.float64, (4, 3, 2), elements=finite))
def test_millimetres_to_cells_and_back(grid, xy):
    np.testing.assert_allclose(grid.xy(*grid.cells(xy)), xy, atol=1e-9)


@given(grids)
def test_axes_are_the_cell_centres(grid):
    x, y = grid.axes()
    rows, columns = np.indices(grid.shape)
    xy = grid.xy(rows, columns)
    assert (len(y), len(x)) == grid.shape
    np.testing.assert_allclose(xy[..., 0], np.broadcast_to(x, grid.shape))
    np.testing.assert_allclose(xy[..., 1], np.broadcast_to(y[:, None], grid.shape))
    assert tuple(xy[0, 0]) == pytest.approx(grid.origin)


def test_the_protocol_grid():
    """64 x 64 cells, centres at (i - 31.5) * 0.4 mm."""
    grid = Grid.centred(64, 0.4)
    x, y = grid.axes()
    np.testing.assert_allclose(x, (np.arange(64) - 31.5) * 0.4)
    np.testing.assert_allclose(y, x)
    row, column = grid.cells([0.0, 0.4])
    assert (row, column) == (pytest.approx(32.5), pytest.approx(31.5))  # y down the rows


@pytest.mark.parametrize("radius", [0.0, -1.0])
def test_an_indenter_has_a_size(radius):
    with pytest.raises(ValueError, match="radius"):
        Indenter.single(radius)
    with pytest.raises(ValueError, match="tip"):
        Indenter(3.0, (), "none")


@given(st.floats(1, 20))
def test_a_dual_indenter_is_symmetric(distance):
    left, right = np.array(Indenter.dual(distance).offsets)
    np.testing.assert_allclose(right - left, [distance, 0, 0])
    np.testing.assert_allclose(left + right, 0, atol=1e-12)


@given(st.floats(1, 20), st.tuples(*[st.floats(0, 3)] * 3))
def test_a_triple_indenter_is_equilateral_around_its_axis(side, heights):
    tips = np.array(Indenter.triple(heights, side).offsets)
    np.testing.assert_allclose(tips[:, 2], heights)
    np.testing.assert_allclose(tips[:, :2].sum(axis=0), 0, atol=1e-9)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        assert np.linalg.norm(tips[a, :2] - tips[b, :2]) == pytest.approx(side)
