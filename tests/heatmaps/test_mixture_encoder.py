"""The encoder whose cells speak of contacts with a probability and a std."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import Contacts, Grid, UserError
from tactibench_heatmaps import Mixture

GRID = Grid.centred(64, 0.4)
COARSE = Grid.centred(16, 1.6)
ENCODER = Mixture()
grids = pytest.mark.parametrize("grid", [GRID, COARSE], ids=["fine", "coarse"])
place = st.floats(-6.4, 6.4)


def columns(contacts):
    """(K, 3) rows of contacts in the order of x."""
    rows = np.column_stack([contacts.xy, contacts.depth])
    return rows[np.argsort(rows[:, 0])]


def scattered(seed, count, closest):
    """Contacts no closer than ``closest``."""
    rng = np.random.default_rng(seed)
    xy = np.empty((0, 2))
    while len(xy) < count:
        one = rng.uniform(-6.4, 6.4, (1, 2))
        if (np.linalg.norm(xy - one, axis=1) >= closest).all():
            xy = np.concatenate([xy, one])
    return Contacts.truth(xy, rng.uniform(0.5, 6, count))


@grids
@given(place, place, st.floats(0.5, 6.0))
@settings(max_examples=60, deadline=None)
def test_round_trip(grid, x, y, depth):
    found = ENCODER.decode(ENCODER.encode(Contacts.truth([[x, y]], [depth]), grid), grid)
    np.testing.assert_allclose(columns(found), [[x, y, depth]], rtol=0, atol=ENCODER.tolerance)
    assert found.score.tolist() == [1.0]
    assert found.std is None


@grids
@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
@settings(max_examples=40, deadline=None)
def test_several_contacts_as_close_as_the_separation(grid, seed, count):
    truth = scattered(seed, count, ENCODER.separation)
    found = ENCODER.decode(ENCODER.encode(truth, grid), grid)
    assert len(found) == count
    np.testing.assert_allclose(columns(found), columns(truth), rtol=0, atol=ENCODER.tolerance)


@grids
def test_what_a_model_says_of_itself_comes_back(grid):
    std = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])
    stated = Contacts([[1, 2], [-3, 4]], [2, 3], [0.9, 0.7], std)
    found = ENCODER.decode(ENCODER.encode(stated, grid), grid)
    np.testing.assert_allclose(found.std, std, rtol=1e-6)
    np.testing.assert_allclose(found.score, [0.9, 0.7], rtol=1e-6)
    np.testing.assert_allclose(found.xy, stated.xy, atol=1e-6)


def test_channels_are_those_the_docstring_names():
    contact = Contacts([[0.3, -1.0]], [2.5], [0.8], [[0.1, 0.2, 0.3]])
    maps = ENCODER.encode(contact, COARSE)
    assert maps.shape == (7, 16, 16)
    assert maps.dtype == np.float32
    row, column = np.unravel_index(maps[0].argmax(), (16, 16))
    centre = COARSE.xy(row, column)
    offset = contact.xy[0] - centre
    assert (np.abs(offset) <= 0.8).all()
    expected = [0.8, *offset, 2.5, 0.1, 0.2, 0.3]
    np.testing.assert_allclose(maps[:, row, column], expected, rtol=1e-6)
    assert np.count_nonzero(maps) == 7


def test_a_shift_by_a_cell_shifts_the_map():
    one = ENCODER.encode(Contacts.truth([[0.1, 0.3]], [2.0]), COARSE)
    other = ENCODER.encode(Contacts.truth([[1.7, 0.3]], [2.0]), COARSE)
    np.testing.assert_allclose(other[:, :, 1:], one[:, :, :-1], atol=1e-6)


def test_contacts_of_one_cell_take_neighbouring_cells():
    maps = ENCODER.encode(Contacts.truth([[0.7, 0.7], [0.8, 0.9], [0.9, 0.8]], [1, 2, 3]), COARSE)
    assert np.count_nonzero(maps[0]) == 3
    near = Mixture(merge=0.05)
    np.testing.assert_allclose(
        columns(near.decode(maps, COARSE)), [[0.7, 0.7, 1], [0.8, 0.9, 2], [0.9, 0.8, 3]], atol=1e-5
    )


def test_more_contacts_than_cells_are_refused():
    with pytest.raises(UserError, match="more contacts than"):
        ENCODER.encode(scattered(1, 2, 3.0), Grid.centred(1, 20.0))


def test_a_neighbour_with_the_same_contact_adds_to_its_score():
    maps = np.zeros((7, 16, 16), np.float32)
    maps[:4, 8, 8] = [0.5, 0.8, 0, 2]
    maps[:4, 8, 9] = [0.4, -0.8, 0, 2]
    (found,) = ENCODER.decode_batch(maps[None], COARSE)
    assert len(found) == 1
    assert found.score[0] == pytest.approx(0.9)
    assert found.xy[0, 0] == pytest.approx(1.6)
