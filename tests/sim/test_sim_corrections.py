"""Corrections: splines, patches and modes against scipy and fields in closed form."""

import math

import learn
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from learn import Single, corrections_from, mirror
from modes import FOUR, Cells, Chart, coefficients, modes_of, on_cells, six, turn
from scipy.interpolate import CubicSpline

from tactibench_sim.mechanics.corrections import Corrections
from tactibench_sim.mechanics.kernels import (
    around_amounts,
    look_up,
    pair_amounts,
    patch_at,
    weights,
)
from tactibench_sim.mechanics.kernels import place as place_of
from tactibench_sim.mechanics.tables import Tables, shipped

TABLES = shipped()
STEP = math.radians(5)
CELLS = Cells(start=-10 * STEP, along=21, across=11, step=STEP, fade=2, closed=True)
CHART = Chart(start=-75.0, reach=75.0, across=75.0, step=2.5)


def read(spline, step, at):
    left, fraction = place_of(at, step, len(spline) - 2)
    return sum(w * spline[left + k] for k, w in enumerate(weights(fraction)))


@pytest.mark.parametrize("nodes", [13, 14, 25, 36])
def test_coefficients_are_those_of_the_natural_spline(nodes):
    rng = np.random.default_rng(nodes)
    values, step = rng.normal(size=nodes), 0.3
    told = CubicSpline(np.arange(nodes) * step, values, bc_type="natural")
    spline = coefficients(values, (0,))
    assert spline.shape == (nodes + 2,)
    at = np.linspace(0, (nodes - 1) * step, 201)
    assert [read(spline, step, x) for x in at] == pytest.approx(told(at), abs=1e-6)


def test_coefficients_along_several_axes_are_the_tensor_spline():
    values = np.random.default_rng(1).normal(size=(13, 14, 4))
    found = coefficients(values, (0, 1))
    assert found.shape == (15, 16, 4)
    assert found.flags.c_contiguous
    for x, y in [(0.0, 0.0), (2.3, 7.9), (8.0, 13.0), (7.5, 0.5)]:
        over = CubicSpline(np.arange(14), values, axis=1, bc_type="natural")(y)
        told = CubicSpline(np.arange(13), over, bc_type="natural")(x)
        assert read(read(found, 1.0, x), 1.0, y) == pytest.approx(told, abs=1e-6)


def smooth(directions):
    """(..., 6) u and q along e, f, m of a field with the mirror plane f = 0."""
    x, y, z = np.moveaxis(directions, -1, 0)
    bump = np.exp(3 * (z - 1) + 0.4 * x)
    even, odd = bump * np.cos(2 * y), bump * np.sin(2 * y)
    return np.stack([even * x, odd, even, 0.3 * even, x * odd, -even * z], axis=-1)


@pytest.fixture(scope="module")
def patch():
    return coefficients(on_cells(smooth(CHART.directions()), CHART, CELLS), (0, 1))


def at_angle(r, azimuth):
    return (math.sin(r) * math.cos(azimuth), math.sin(r) * math.sin(azimuth), math.cos(r))


@settings(max_examples=60, deadline=None)
@given(st.floats(0, math.radians(22)), st.floats(-math.pi, math.pi), st.integers(0, 100))
def test_a_gathered_field_is_looked_up_again(patch, r, azimuth, seed):
    """Inside the window, in any frame; what lies at b < 0 is the mirror image."""
    frame = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    direction = np.array(at_angle(r, azimuth))
    found = look_up(patch, CELLS.step, CELLS.start, frame, *(direction @ frame))
    # The splines' natural end takes the field's bend away at b = 0 and some nodes beside it.
    assert found == pytest.approx(smooth(direction), abs=5e-3)
    if abs(r * math.sin(azimuth)) > 2.5 * STEP:
        assert found == pytest.approx(smooth(direction), abs=1e-3)


def test_a_finer_grid_looks_up_better():
    """Cubic splines: half the step, a sixteenth of the error (an eighth is asked for)."""
    beside = [at_angle(math.radians(r), 1.5) for r in np.linspace(12, 22, 41)]
    worst = []
    for k in (1, 2):
        cells = Cells(-10 * STEP, 20 * k + 1, 10 * k + 1, STEP / k, 2 * k, closed=True)
        chart = Chart(-75.0, 75.0, 75.0, 2.5 / k)
        grid = coefficients(on_cells(smooth(chart.directions()), chart, cells), (0, 1))
        found = [look_up(grid, cells.step, cells.start, np.eye(3), *at) for at in beside]
        worst.append(abs(np.array(found) - smooth(np.array(beside))).max())
    assert worst[1] < worst[0] / 8


def test_a_patch_ends_at_nothing(patch):
    for direction in (at_angle(math.radians(52), 0), at_angle(math.radians(60), 2.0)):
        found = look_up(patch, CELLS.step, CELLS.start, np.eye(3), *direction)
        assert found == pytest.approx(np.zeros(6), abs=1e-6)


@pytest.mark.parametrize("cells", [learn.AROUND, learn.PAIR, CELLS])
def test_windows_fall_to_nothing_where_they_must(cells):
    window = cells.window()
    assert window.shape == (cells.along, cells.across)
    assert (window[-1] == 0).all()
    assert (window[:, -1] == 0).all()
    assert (window[0] == 0).all() == cells.closed
    assert window[cells.along // 2, 0] == 1
    assert (np.diff(window, axis=1) <= 0).all()


def test_places_are_the_directions_of_the_nodes():
    a, b = (np.radians(degrees) for degrees in CELLS.places())
    r = np.hypot(a, b)
    chord = np.hypot(*np.meshgrid(CELLS.a, CELLS.b, indexing="ij"))
    assert 2 * np.sin(r / 2) == pytest.approx(chord, abs=1e-12)
    assert np.arctan2(b, a)[r > 0] == pytest.approx(
        np.arctan2(*np.meshgrid(CELLS.b, CELLS.a))[r > 0], abs=1e-12
    )


@given(st.floats(1e-6, 3.0), st.floats(-math.pi, math.pi))
def test_turn_is_the_angle_towards_the_normal(angle, azimuth):
    normal = np.array(at_angle(angle, azimuth))
    found = turn(np.array([0.0, 0.0, 1.0]), normal)
    told = angle * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    assert found == pytest.approx(told, abs=1e-9)


def test_a_shift_of_the_whole_turns_nothing():
    shift = np.broadcast_to([0.3, 0.0, -0.8], (*CHART.directions().shape[:2], 3))
    found = six(CHART, 19.0, shift)
    assert found[..., :3] == pytest.approx(shift)
    assert abs(found[..., 3:]).max() < 1e-4


def test_modes_are_orthonormal_and_give_the_snapshots_again():
    rng = np.random.default_rng(3)
    snapshots = np.einsum("nr,rabc->nabc", rng.normal(size=(20, 6)), rng.normal(size=(6, 5, 4, 3)))
    amounts, modes = modes_of(snapshots, 8)
    assert amounts.shape == (20, 8)
    assert np.einsum("nr,rabc->nabc", amounts, modes) == pytest.approx(snapshots)
    flat = modes.reshape(8, -1)
    assert flat @ flat.T == pytest.approx(np.eye(8), abs=1e-12)


@pytest.mark.parametrize(("count", "most", "rank"), [(20, 8, 8), (6, 8, 4), (20, 4, 4), (4, 12, 4)])
def test_modes_come_in_fours(count, most, rank):
    snapshots = np.random.default_rng(count).normal(size=(count, 5, 4, 3))
    amounts, modes = modes_of(snapshots, most)
    assert amounts.shape == (count, rank)
    assert len(modes) == rank
    assert rank % FOUR == 0


def test_fewer_modes_leave_out_the_least():
    """Eckart and Young: what is left out are the smaller singular values."""
    snapshots = np.random.default_rng(5).normal(size=(12, 5, 4, 3))
    amounts, modes = modes_of(snapshots, 4)
    rest = snapshots - np.einsum("nr,rabc->nabc", amounts, modes)
    values = np.linalg.svd(snapshots.reshape(12, -1), compute_uv=False)
    assert (rest**2).sum() == pytest.approx((values[4:] ** 2).sum())


def test_mirroring_twice_changes_nothing():
    values = np.random.default_rng(0).normal(size=(3, 29, 15, 12))
    assert (mirror(mirror(values)) == values).all()
    assert (mirror(values)[:, 3, :, 1:3] == values[:, -4, :, 1:3]).all()
    assert (mirror(values)[:, 3, :, ::3] == -values[:, -4, :, ::3]).all()


def test_depths_start_at_nothing_and_go_on_straight():
    depths = np.array([0.5, 1.0, 2.0, 4.0, 5.0])
    values = depths[:, None] * np.array([1.0, -2.0])
    found = learn.evenly(depths, values, learn.DEPTHS, learn.DEPTH_STEP_MM)
    told = np.arange(learn.DEPTHS)[:, None] * learn.DEPTH_STEP_MM * np.array([1.0, -2.0])
    assert found == pytest.approx(told)


def single(degrees, scale=1.0):
    """A contact whose displacement grows with the angle, the depth and nothing else."""
    chart = Chart(-120.0, 120.0, 120.0, 2.5)
    field = smooth(chart.directions())[..., :3]
    depths = np.arange(1, 14) / 2
    beta = math.radians(degrees)
    amount = 0.02 + scale * (beta - 0.3 * beta**3)
    u = amount * (depths * (1 + 0.1 * depths))[:, None, None, None] * field
    return Single(3.0, beta, depths, chart, np.stack([u, 0.5 * u], axis=1))


@pytest.fixture(scope="module")
def around():
    plain = Tables(TABLES.parameters, "", TABLES.by_radius, Corrections())
    return corrections_from([single(degrees, 0.02) for degrees in (0, 20, 40, 55)], [], plain)


@pytest.mark.parametrize(("degrees", "depth"), [(10, 1.5), (35, 4.0), (55, 6.5), (0, 3.0), (40, 0)])
def test_corrections_learned_are_the_fields_they_came_from(around, degrees, depth):
    """At the nodes of beta and depth, whatever the direction."""
    beta = math.radians(degrees)
    amount = 0.02 * (beta - 0.3 * beta**3) * depth * (1 + 0.1 * depth)
    for where, part in (("base", 1.0), ("skin", 0.5)):
        known = around.around(where, (3.0,))
        amounts, out = np.empty(known.amounts.shape[-1]), np.empty(6)
        around_amounts(known, 0, beta, depth, amounts)
        for r, azimuth in [(0.0, 0.0), (0.3, 1.0), (0.7, -2.0), (1.0, 1.2)]:
            direction = np.array(at_angle(r, azimuth))
            patch_at(known.modes, amounts, np.eye(3), direction, out)
            told = part * amount * smooth(direction)[:3]
            close = 1e-2 if abs(direction[1]) < 4 * STEP else 2e-3  # natural ends at b = 0
            assert out[:3] == pytest.approx(told, abs=close * part * amount + 1e-9)


def test_corrections_of_an_unknown_radius_are_nothing(around):
    known = around.around("base", (2.0, 3.0))
    assert (known.amounts[0] == 0).all()
    assert (known.amounts[1] != 0).any()


def test_nothing_is_corrected_where_nothing_was_learned():
    none = Corrections()
    assert (none.around("base", (3.0,)).amounts == 0).all()
    assert none.pairs("base", (3.0,)).indenter == -1


@pytest.mark.parametrize("where", ["base", "skin"])
def test_pair_modes_are_exactly_even_or_odd(where):
    """Exchanging the contacts mirrors a: the even modes stay, the odd ones turn over."""
    modes = TABLES.corrections.pairs(where, (3.0,)).modes.grid
    even = TABLES.corrections.grid["pair_even"]
    other = modes[:, ::-1] * np.array([-1.0, 1.0, 1.0] * 2)
    assert (modes[:even] == other[:even]).all()
    assert (modes[even:] == -other[even:]).all()


@given(st.floats(0.05, 1.0), st.floats(0.1, 6.4), st.floats(0.1, 6.4))
def test_pair_amounts_have_the_parity_of_their_modes(angle, first, second):
    pairs = TABLES.corrections.pairs("base", (3.0,))
    even = TABLES.corrections.grid["pair_even"]
    one, other = np.empty(pairs.amounts.shape[-1]), np.empty(pairs.amounts.shape[-1])
    pair_amounts(pairs, angle, first, second, one)
    pair_amounts(pairs, angle, second, first, other)
    assert one[:even] == pytest.approx(other[:even], abs=1e-12)
    assert one[even:] == pytest.approx(-other[even:], abs=1e-12)
