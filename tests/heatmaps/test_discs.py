"""What the maps of ``depth``, ``offset`` and ``mixture`` hold, by plain loops."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tactibench import Contacts, Grid, UserError
from tactibench_heatmaps import HeatAndDepth, Mixture, Offsets
from tactibench_heatmaps.hooks import tactibench_encoders

SMALL = Grid((11, 14), (-2.0, -1.6), 0.4)
GRID = Grid.centred(64, 0.4)
PAIR = Contacts.truth([[-0.53, 0.21], [1.87, 0.64]], [1.5, 4.2])


def cells(grid: Grid) -> list[tuple[int, int, float, float]]:
    x, y = grid.axes()
    return [(i, j, x[j], y[i]) for i in range(grid.shape[0]) for j in range(grid.shape[1])]


@pytest.mark.parametrize("kind", [HeatAndDepth, Offsets])
def test_discs_are_the_formula(kind: type) -> None:
    """Heat exp(-r^2 / 2 0.8^2); within 2 mm the nearer contact's depth / 6 and steps / 4 + 1/2."""
    maps = kind().encode(PAIR, SMALL)
    for i, j, x, y in cells(SMALL):
        steps = PAIR.xy - [x, y]
        nearest = int(np.hypot(*steps.T).argmin())
        far = math.hypot(*steps[nearest])
        expected = [math.exp(-(far**2) / (2 * 0.8**2))]
        near = far <= 2.0
        if kind is Offsets:
            expected += list(0.5 + steps[nearest] / 4.0) if near else [0.5, 0.5]
        expected.append(PAIR.depth[nearest] / 6.0 if near else 0.0)
        np.testing.assert_allclose(maps[:, i, j], expected, rtol=1e-5, atol=1e-7)


def test_depth_does_not_move_with_the_heat() -> None:
    """A network that draws the heat too low, too wide or with noise still says the same depth."""
    encoder = HeatAndDepth()
    maps = encoder.encode(PAIR, GRID)
    maps[0] = 0.6 * maps[0] + 0.02 * np.random.default_rng(1).random((64, 64))
    found = encoder.decode(maps, GRID)
    assert sorted(found.depth[:2]) == pytest.approx([1.5, 4.2], abs=1e-3)


def test_offsets_are_read_where_the_heat_is_blunt() -> None:
    """A plateau says nothing about where; the steps of its cells do."""
    encoder = Offsets()
    maps = encoder.encode(PAIR.top(1), GRID)
    maps[0] = np.minimum(maps[0], 0.5)
    found = encoder.decode(maps, GRID)
    np.testing.assert_allclose(found.xy, PAIR.xy[:1], atol=encoder.tolerance)


@pytest.mark.parametrize("kind", [HeatAndDepth, Offsets])
def test_peaks_in_one_another_are_still_read(kind: type) -> None:
    """Without a least distance, neighbouring cells may be peaks that own no cell."""
    encoder = kind(min_distance=0.0)
    maps = encoder.encode(PAIR.top(1), GRID)
    maps[0] = 0.0
    maps[0, 30, [30, 32]] = 0.9, 0.8
    found = encoder.decode(maps, GRID)
    assert len(found) == 2
    assert np.isfinite(found.xy).all()
    assert ((found.depth >= 0) & (found.depth <= 6.0)).all()


@pytest.mark.parametrize("kind", [HeatAndDepth, Offsets])
def test_discs_of_less_than_two_cells_are_refused(kind: type) -> None:
    with pytest.raises(UserError, match=r"reach 0\.7 mm, less than 2 cells of 0\.4 mm"):
        kind(reach=0.7).encode(PAIR, GRID)


COARSE = Grid.centred(16, 1.6)
ENCODER = Mixture()
grids = pytest.mark.parametrize("grid", [GRID, COARSE], ids=["fine", "coarse"])


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


SPECS = {spec.name: spec for spec in tactibench_encoders()}
# what changes the maps that a model is trained on, and so its weights
SHAPING = {
    "hertz": {"max_depth", "radius", "blur"},
    "depth": {"max_depth", "sigma", "reach"},
    "offset": {"max_depth", "sigma", "reach"},
}


@pytest.mark.parametrize("name", SHAPING)
def test_what_shapes_the_maps_is_not_decode_only(name: str) -> None:
    assert {p.name for p in SPECS[name].parameters if not p.decode_only} == SHAPING[name]
