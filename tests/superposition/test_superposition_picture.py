"""How pins look, learned from frames and drawn again, and how sure they are."""

from __future__ import annotations

import numpy as np
import pytest

from tactibench.markers import PinTracker
from tactibench.superposition import PinPicture

GROUND, BRIGHT, SIGMA = 24.0, 150.0, 1.1


def true_picture(pins, brightness, size=80):
    """(H, W) grey levels without noise: Gaussian spots on a flat ground."""
    axis = np.arange(size)
    along = np.exp(-((axis - pins[..., None]) ** 2) / (2 * SIGMA**2))
    return GROUND + np.einsum("p,px,py->yx", brightness, along[:, 0], along[:, 1])


def noisy(clean, noise, rng):
    spread = np.sqrt(noise[0] + noise[1] * clean)
    return np.rint(clean + spread * rng.standard_normal(clean.shape)).clip(0, 255).astype(np.uint8)


def frames(rest, count, rng, noise=(4.0, 0.05)):
    """Images (N, H, W), pins (N, P, 2) px, brightness (N, P) between 0.7 and 1.3 of BRIGHT."""
    pins = rest + rng.normal(0, 0.6, (count, *rest.shape))
    brightness = BRIGHT * rng.uniform(0.7, 1.3, pins.shape[:2])
    clean = [true_picture(*one) for one in zip(pins, brightness, strict=True)]
    return noisy(np.array(clean), noise, rng), pins, brightness


@pytest.fixture(scope="module")
def seen(pins):
    return frames(pins, 150, np.random.default_rng(1))


@pytest.fixture(scope="module")
def picture(seen):
    return PinPicture.learn(*seen[:2])


def test_ground_light_and_noise_are_those_of_the_frames(picture):
    assert np.abs(picture.background - GROUND).mean() < 1.0
    # A spot in the middle of the sizes has the known profile.
    middle = len(picture.sizes) // 2
    distance = 0.1 * (np.arange(picture.light.shape[1]) + 0.5)
    near = distance < 2.5
    wanted = BRIGHT * np.exp(-(distance[near] ** 2) / (2 * SIGMA**2))
    np.testing.assert_allclose(picture.light[middle][near], wanted, atol=0.08 * BRIGHT)
    assert (np.diff(picture.sizes) > 0).all()
    level = np.array([GROUND, 100.0, 170.0])
    # In whole grey levels a median tells a spread of 2.2 to a sixth.
    spread = np.sqrt([picture.noise[0] + picture.noise[1] * level, 4 + 1 / 12 + 0.05 * level])
    np.testing.assert_allclose(*spread, rtol=0.2)


def test_drawn_frames_have_the_mean_and_the_variance_of_the_real_ones(picture, seen, pins):
    rng = np.random.default_rng(2)
    brightness = np.full(len(pins), BRIGHT)
    clean = true_picture(pins, brightness)
    real = noisy(np.repeat(clean[None], 400, axis=0), (4.0, 0.05), rng).astype(float)
    size = picture.measure(real[:60].astype(np.uint8), np.repeat(pins[None], 60, axis=0))
    places = np.repeat(pins[None], 400, axis=0)
    drawn = picture.draw(places, np.repeat(size.mean(axis=0)[None], 400, axis=0), rng)
    assert drawn.dtype == np.uint8
    assert drawn.shape == real.shape
    off = drawn.mean(axis=0) - real.mean(axis=0)
    assert np.sqrt((off**2).mean()) < 0.03 * BRIGHT
    assert abs(off.mean()) < 0.25
    spread = [np.sqrt(one.astype(float).var(axis=0).mean()) for one in (drawn, real)]
    assert spread[0] == pytest.approx(spread[1], rel=0.2)
    # Bright pixels are noisier than the ground in both.
    bright = clean > 120
    for one in (drawn, real):
        one = one.astype(float).var(axis=0)
        assert one[bright].mean() > 1.15 * one[clean < GROUND + 3].mean()


def centre(light):
    """(x, y) px of the centre of light of a picture."""
    y, x = np.mgrid[: light.shape[0], : light.shape[1]]
    return np.array([(light * x).sum(), (light * y).sum()]) / light.sum()


@pytest.mark.parametrize("shift", [(0.25, -0.4), (1.3, 0.7)])
def test_a_pin_drawn_elsewhere_has_its_centre_there(picture, pins, shift):
    dark = PinPicture(np.zeros((80, 80)), picture.light, picture.sizes, np.zeros(2), picture.reach)
    inner = pins[np.hypot(*(pins - 39.5).T) < 30] + shift
    for size in picture.sizes[[1, -2]]:
        # One pin a frame.
        sizes = np.full((len(inner), 1), size)
        drawn = dark.draw(inner[:, None], sizes, np.random.default_rng(0))
        found = np.array([centre(image.astype(float)) for image in drawn])
        np.testing.assert_allclose(found, inner, atol=0.08)
        np.testing.assert_allclose((found - inner).mean(axis=0), 0, atol=0.02)


@pytest.mark.parametrize("lost", [0, 30])
def test_around_a_pin_that_is_not_seen_all_are_doubtful(singles, pins, draw_pins, lost):
    """The lost one and its ring of neighbours at least; those far off are not."""
    tracker = PinTracker.of(singles[0])
    image = draw_pins(np.delete(pins, lost, axis=0))
    moved, sure = tracker.track(np.stack([image, draw_pins(pins)]))
    here = np.argmin(np.linalg.norm(tracker.rest - pins[lost], axis=1))
    spacings = np.linalg.norm(tracker.rest - tracker.rest[here], axis=1) / tracker.pitch
    assert not sure[0, spacings < 1.2].any()
    assert sure[0, spacings > 3].all()
    assert sure[1].all()
    assert np.isfinite(moved).all()
