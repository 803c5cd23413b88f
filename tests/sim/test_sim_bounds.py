"""Cramer-Rao bounds against closed forms, on frames of soft discs that move with the contacts."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench_sim import (
    NUISANCES,
    Tips,
    covariance,
    derivatives,
    inverse,
    marginal,
)

EDGE, RADIUS, HEIGHT, NOISE = 3.0, 8.0, 20.0, 2.0
PX_PER_MM = 5.0


def tips(*contacts):
    values = np.array(contacts, dtype=float).reshape(1, -1, 3)
    return Tips(values[..., :2], values[..., 2], np.full(1, 3.0))


def disc(x, y, size):
    """(S, size, size) smoothstep discs at (S,) px from the middle."""
    rows, columns = np.mgrid[:size, :size] - (size - 1) / 2
    distance = np.hypot(columns - x[:, None, None], rows - y[:, None, None])
    t = np.clip((RADIUS + EDGE - distance) / (2 * EDGE), 0, 1)
    return t * t * (3 - 2 * t)


def discs(*offsets, size=64, background=7.0):
    """A sensor: every contact moves a disc at each offset (px) and makes it brighter with depth."""

    def clean(scene):
        out = np.full((len(scene), size, size), background)
        for k in range(scene.depth.shape[1]):
            depth = np.where(np.isfinite(scene.depth[:, k]), scene.depth[:, k], 0.0)
            for dx, dy in offsets:
                at = PX_PER_MM * scene.xy[:, k] + [dx, dy]
                out += HEIGHT * depth[:, None, None] * disc(*at.T, size)
        return out

    return clean


def deviations(matrix):
    return np.sqrt(np.diag(matrix)).reshape(-1, 3)


def white(image):
    return np.full(image.shape, NOISE**2)


def bound(scene, clean, nuisances=(), variance=white, step=0.004):
    return deviations(covariance(scene, clean, variance, nuisances, step))


def test_one_soft_disc_has_the_closed_form():
    """Integral of (df/dx)^2 over a disc A S((r + e - rho) / 2e), S = 3 t^2 - 2 t^3:

    pi A^2 / (2 e) * integral S'^2 (r + e - 2 e t) dt = 0.6 pi A^2 r / e, so that
    sigma_x = (s / A) sqrt(e / (0.6 pi r)). Its height has sigma_A = s / sqrt(integral S^2 dA),
    integral S^2 dA = 2 pi integral S^2 (r + e - 2 e t) 2 e dt.
    """
    depth = 1.5
    (found,) = bound(tips((0.31, -0.17, depth)), discs((0, 0)))
    amplitude = HEIGHT * depth
    sideways = NOISE / amplitude * np.sqrt(EDGE / (0.6 * np.pi * RADIUS)) / PX_PER_MM
    t = (np.arange(20000) + 0.5) / 20000
    step = (3 * t**2 - 2 * t**3) ** 2
    inside = np.pi * (RADIUS - EDGE) ** 2
    area = inside + 2 * np.pi * np.mean(step * (RADIUS + EDGE - 2 * EDGE * t)) * 2 * EDGE
    assert found == pytest.approx([sideways, sideways, NOISE / HEIGHT / np.sqrt(area)], rel=2e-3)


def test_contacts_that_share_no_pixel_are_independent():
    places = [(-4.0, -3.5, 1.0), (4.0, -3.0, 2.0), (0.5, 4.0, 0.5)]
    clean = discs((0, 0), size=80)
    together = covariance(tips(*places), clean, white)
    for k, place in enumerate(places):
        block = slice(3 * k, 3 * k + 3)
        alone = covariance(tips(place), clean, white)
        assert together[block, block] == pytest.approx(alone, rel=1e-9, abs=1e-15)
        together[block, block] = 0
    assert np.abs(together).max() < 1e-15


def test_the_variance_of_the_shot_noise_tells_a_little():
    """With v = a m: w = 1 / (a m) + 1 / (2 m^2), a closed form for one parameter, the gain."""
    a, level = 0.5, 100.0

    def clean(scene):
        return np.tile(level * scene.depth[:, 0, None, None], (1, 8, 8))

    found = covariance(tips((0, 0, 1.0)), clean, lambda m: a * m)[2, 2]
    assert 1 / found == pytest.approx(64 * level**2 * (1 / (a * level) + 0.5 / level**2))


def test_what_moves_no_pixel_has_no_bound():
    scene = tips((0, 0, 1.0), (20.0, 0, 1.0))  # the second disc lies beside the frame
    found = bound(scene, discs((0, 0)))
    assert np.isfinite(found[0]).all()
    assert np.isinf(found[1]).all()
    assert bound(scene, discs((0, 0)), NUISANCES)[1] == pytest.approx([np.inf] * 3)


def test_two_contacts_at_one_place_have_no_bound_each():
    found = covariance(tips((1, 0, 1.0), (1, 0, 1.0)), discs((0, 0)), white)
    assert np.isinf(np.diag(found)).all()
    assert (found[~np.eye(6, dtype=bool)] == 0).all()


def test_no_contact_no_bound():
    for depth in (0.0, -1.0, -np.inf):
        assert bound(tips((0, 0, depth)), discs((0, 0))).shape == (0, 3)
    assert bound(tips((0, 0, 0.0), (2, 0, 1.0)), discs((0, 0))).shape == (1, 3)


def test_a_nuisance_that_looks_like_the_contact_hides_it():
    """A camera that may have moved is no reference for the only disc it sees."""
    found = bound(tips((0.1, 0.2, 1.0)), discs((0, 0)), ["shift"])
    assert (found[0, :2] > 20 * bound(tips((0.1, 0.2, 1.0)), discs((0, 0)))[0, :2]).all()
    still = discs((0, 0))

    def with_reference(scene):
        return still(scene) + 30 * disc(np.array([-20.0]), np.array([-20.0]), 64)

    known = bound(tips((0.1, 0.2, 1.0)), with_reference)
    shared = bound(tips((0.1, 0.2, 1.0)), with_reference, ["shift"])
    # both discs have the same shape: the camera's own sd by the second adds to the contact's
    ratio = np.sqrt(1 + (HEIGHT / 30) ** 2)
    assert shared[0, :2] / known[0, :2] == pytest.approx([ratio, ratio], rel=0.02)


@settings(max_examples=20)
@given(
    st.sets(st.sampled_from(NUISANCES)),
    st.sets(st.sampled_from(NUISANCES)),
    st.floats(0.3, 4),
    st.floats(0.4, 3),
)
def test_a_nuisance_never_lowers_a_bound(some, more, depth, half):
    scene = tips((-half, 0.3, depth), (half, -0.2, 1.0))
    clean = discs((-5, 0), (11, 6))
    least = bound(scene, clean)
    few = bound(scene, clean, tuple(some))
    many = bound(scene, clean, (*some, *more))
    assert (few >= least * (1 - 1e-9)).all()
    assert (many >= few * (1 - 1e-9)).all()


@given(st.integers(1, 5), st.integers(0, 3), st.integers(0, 2**32 - 1), st.floats(-6, 6))
def test_the_schur_complement_is_the_block_of_the_inverse(kept, others, seed, decades):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(kept + others, 40)) * 10.0 ** rng.uniform(-3, 3, (kept + others, 1))
    information = root @ root.T * 10.0**decades
    expected = np.linalg.inv(information)[:kept, :kept]
    found = inverse(marginal(information, kept))
    scale = np.sqrt(np.diag(expected))
    assert found / np.outer(scale, scale) == pytest.approx(
        expected / np.outer(scale, scale), abs=1e-6
    )


# -- derivatives by unknown properties of the camera

MIDDLE = 20.0


def spot(x=4.0, y=-2.5, turn=0.0, zoom=1.0, gain=1.0, offset=0.0, variance=6.0):
    """(41, 41) a Gaussian spot seen by a camera that was moved, turned, zoomed, blurred."""
    rows, columns = np.mgrid[:41, :41] - MIDDLE
    c, s = np.cos(turn), np.sin(turn)
    at = zoom * (c * x - s * y), zoom * (s * x + c * y)
    shape = np.exp(-((columns - at[0]) ** 2 + (rows - at[1]) ** 2) / (2 * variance)) / variance
    return gain * (10 + 500 * shape) + offset


@pytest.mark.parametrize(
    ("name", "moved"),
    [
        ("roll", lambda h: spot(turn=h)),
        ("brightness", lambda h: spot(gain=1 + h)),
        ("background", lambda h: spot(offset=h)),
        ("blur", lambda h: spot(variance=6 + 2 * h)),  # d / d (sigma^2 / 2)
    ],
)
def test_one_parameter(name, moved):
    h = 1e-4
    expected = (moved(h) - moved(-h)) / (2 * h)
    (found,) = derivatives(spot(), [name])
    assert np.abs(found - expected).max() < 1e-2 * np.abs(expected).max()


def test_shift_moves_along_columns_then_rows():
    h = 1e-4
    found = derivatives(spot(), ["shift"])
    for k, (dx, dy) in enumerate([(h, 0), (0, h)]):
        expected = (spot(4 + dx, -2.5 + dy) - spot(4 - dx, -2.5 - dy)) / (2 * h)
        assert np.abs(found[k] - expected).max() < 2e-3 * np.abs(expected).max()
