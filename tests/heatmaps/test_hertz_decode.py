"""Heats of unequal height: the kernel by its formula, what its decoders read, and in noise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import Contacts, Grid
from tactibench_heatmaps import HertzGaussian

GRID = Grid.centred(64, 0.4)
DECODERS = {
    "least-squares": {"decoder": "least-squares"},
    "free-width": {"decoder": "least-squares", "width": "free"},
    "wide": {},
    "wide-free": {"width": "free"},
    "maximum": {"decoder": "maximum"},
}
ENCODERS = {name: HertzGaussian(**words) for name, words in DECODERS.items()}
each_encoder = pytest.mark.parametrize("encoder", ENCODERS.values(), ids=ENCODERS)
each_fit = pytest.mark.parametrize("name", ["least-squares", "free-width", "wide", "wide-free"])


def pair(rng, distance, depth):
    turn = rng.uniform(0, 2 * np.pi)
    half = 0.5 * distance * np.array([np.cos(turn), np.sin(turn)])
    centre = rng.uniform(-3, 3, 2)
    return Contacts.truth([centre - half, centre + half], depth)


@each_encoder
@pytest.mark.parametrize("value", [0.0, 0.5])
def test_a_flat_map_has_no_contact(encoder, value):
    mixed = np.full((2, 1, 64, 64), value, np.float16)
    mixed[1] = encoder.encode(Contacts.truth([[0.1, 0.1]], [3.0]), GRID)
    assert [len(c) for c in encoder.decode_batch(mixed, GRID)] == [0, 1]


@each_encoder
@pytest.mark.parametrize("depth", [0.5, 2.0, 6.0])
def test_equally_deep_pairs_are_told_apart_much_closer(encoder, depth):
    rng = np.random.default_rng(5)
    lists = [pair(rng, 3.6, [depth, depth]) for _ in range(60)]
    found = encoder.decode_batch(encoder.encode_batch(lists, GRID), GRID)
    assert [len(f) for f in found] == [2] * len(lists)


def test_a_bump_on_a_flank_is_no_contact_for_the_fit():
    """A dent in the flank of a deep contact leaves a local maximum behind it, 3.6 mm away."""
    maps = HertzGaussian().encode(Contacts.truth([[0.2, 0.2]], [6.0]), GRID)
    maps[0, 30:35, 38:41] *= 0.7
    assert len(HertzGaussian(decoder="maximum").decode(maps, GRID)) == 2
    fitted = HertzGaussian(decoder="least-squares").decode(maps, GRID)
    assert len(fitted) == 1
    assert fitted.depth[0] == pytest.approx(6.0, abs=0.002)
    assert HertzGaussian().decode(maps, GRID).depth[0] == pytest.approx(6.0, abs=0.1)
    maps[0, 32, 41] *= 1.4  # well above the flank it is a contact again
    assert len(HertzGaussian().decode(maps, GRID)) == 2


@each_fit
@pytest.mark.parametrize("distance", [6.5, 8.0])
def test_neighbours_and_borders_do_not_pull_at_a_fit(name, distance):
    """The declared tolerance, stated for a contact alone, holds for pairs and at the edge."""
    rng, encoder = np.random.default_rng(4), ENCODERS[name]
    lists = [pair(rng, distance, [0.5, 6.0]) for _ in range(100)]
    lists += [pair(rng, distance, rng.uniform(0.5, 6.0, 2)) for _ in range(100)]
    lists += [Contacts.truth([[x, 3.3 * x / 12.6]], [2.5]) for x in (12.6, -12.75, 12.4, -11.5)]
    found = encoder.decode_batch(encoder.encode_batch(lists, GRID), GRID)
    for one, truth in zip(found, lists, strict=True):
        assert len(one) == len(truth)
        nearest = np.linalg.norm(one.xy[:, None] - truth.xy, axis=-1).argmin(axis=0)
        np.testing.assert_allclose(one.xy[nearest], truth.xy, atol=encoder.tolerance)
        np.testing.assert_allclose(one.depth[nearest], truth.depth, atol=encoder.tolerance)


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


def test_parameters_shape_the_kernel():
    wide = HertzGaussian(blur=4.0, radius=0.0, max_depth=8.0)
    maps = wide.encode(Contacts.truth([[0.2, 0.2]], [4.0]), GRID)[0]
    row, column = (round(float(v)) for v in GRID.cells([0.2, 0.2]))
    assert maps[row, column] == pytest.approx(0.5)
    assert maps[row, column + 10] == pytest.approx(0.5 * math.exp(-0.5), rel=1e-5)  # 4 mm away


def position_errors(encoder, maps, truth):
    found = encoder.decode_batch(maps, GRID)
    assert [len(f) for f in found] == [1] * len(truth)
    return np.concatenate([f.xy - t.xy for f, t in zip(found, truth, strict=True)])


def cramer_rao(truth, sigma, window):
    """Bound on the standard deviation of x in white noise, from the cells of the window alone."""
    x, y = GRID.axes()
    information = []
    for contact in truth:
        (cx, cy), d = contact.xy[0], contact.depth[0]
        variance = 3.0 * d / 9.0 + 4.0
        near_x = x[np.argsort(np.abs(x - cx))[:window]]
        near_y = y[np.argsort(np.abs(y - cy))[:window]]
        dx, dy = near_x[None] - cx, near_y[:, None] - cy
        slope = d / 6.0 * dx / variance * np.exp(-(dx**2 + dy**2) / (2 * variance))
        information.append((slope**2).sum() / sigma**2)
    return 1.0 / np.sqrt(information)


@pytest.mark.parametrize(("decoder", "window"), [("least-squares", 11), ("wide", 17)])
@pytest.mark.parametrize("width", ["free", "kernel"])
def test_white_noise_error_reaches_the_cramer_rao_bound(decoder, window, width):
    rng = np.random.default_rng(10)
    truth = [Contacts.truth(rng.uniform(-6, 6, (1, 2)), rng.uniform(2, 6, 1)) for _ in range(400)]
    encoder = HertzGaussian(decoder=decoder, width=width)
    maps = encoder.encode_batch(truth, GRID)
    noisy = maps + 0.003 * rng.standard_normal(maps.shape)
    z = position_errors(encoder, noisy, truth)[:, 0] / cramer_rao(truth, 0.003, window)
    assert 0.9 < z.std() < 1.2  # 400 samples: the sample deviation itself is good to 3.5 %
    assert abs(z.mean()) < 0.2


@pytest.mark.parametrize("scale", [0.9, 1.1])
def test_a_blurred_kernel_does_not_bias_the_free_fit(scale):
    """A network may draw wider or narrower kernels; position and height are still read."""
    x, y = GRID.axes()
    cx, cy, d = 1.13, -2.71, 3.0
    variance = (4 + d / 3) * scale**2
    maps = d / 6 * np.exp(-((x - cx) ** 2 + (y[:, None] - cy) ** 2) / (2 * variance))[None]
    free = HertzGaussian(width="free").decode(maps, GRID)
    assert np.abs(free.xy - [cx, cy]).max() < 0.002
    assert abs(free.depth[0] - d) < 0.002
    held = HertzGaussian().decode(maps, GRID)
    assert abs(held.depth[0] - d) > 0.05
