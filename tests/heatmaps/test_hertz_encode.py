"""The kernel of the paper on the grid, against the formula written out cell by cell."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import Contacts, Grid
from tactibench_heatmaps import HertzGaussian

GRID = Grid.centred(64, 0.4)
SMALL = Grid((9, 12), (-2.0, -1.5), 0.5)
place = st.floats(-6.4, 6.4)
depths = st.floats(0.5, 6.0)
contact_lists = st.lists(st.tuples(place, place, depths), max_size=4)


def contacts_of(rows):
    table = np.array(rows, dtype=float).reshape(-1, 3)
    return Contacts.truth(table[:, :2], table[:, 2])


def formula(rows, grid):
    """Max over contacts of (d/6) exp(-r^2 / 2 sigma^2), sigma_contact = sqrt(3 d)/3, blur 2 mm."""
    out = np.zeros(grid.shape)
    for i in range(grid.shape[0]):
        for j in range(grid.shape[1]):
            cx = grid.origin[0] + j * grid.pitch
            cy = grid.origin[1] + i * grid.pitch
            for x, y, d in rows:
                sigma = math.hypot(math.sqrt(3.0 * d) / 3.0, 2.0)
                r2 = (cx - x) ** 2 + (cy - y) ** 2
                out[i, j] = max(out[i, j], d / 6.0 * math.exp(-r2 / (2 * sigma**2)))
    return out


@given(contact_lists)
@settings(max_examples=40, deadline=None)
def test_encode_is_the_formula(rows):
    maps = HertzGaussian().encode(contacts_of(rows), SMALL)
    assert maps.shape == (1, *SMALL.shape)
    assert maps.dtype == np.float32
    np.testing.assert_allclose(maps[0], formula(rows, SMALL), rtol=2e-6, atol=1e-30)


def test_a_quarter_cell_is_not_rounded_away():
    encoder = HertzGaussian()
    here = encoder.encode(Contacts.truth([[0.2, 0.2]], [3.0]), GRID)
    there = encoder.encode(Contacts.truth([[0.3, 0.2]], [3.0]), GRID)
    assert np.abs(here - there).max() > 1e-3


def test_parameters_shape_the_kernel():
    wide = HertzGaussian(blur=4.0, radius=0.0, max_depth=8.0)
    maps = wide.encode(Contacts.truth([[0.2, 0.2]], [4.0]), GRID)[0]
    row, column = (round(float(v)) for v in GRID.cells([0.2, 0.2]))
    assert maps[row, column] == pytest.approx(0.5)
    assert maps[row, column + 10] == pytest.approx(0.5 * math.exp(-0.5), rel=1e-5)  # 4 mm away
