"""How pins look: learned from frames whose picture is known, and drawn again."""

import numpy as np
import pytest

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


def test_the_size_of_a_pin_is_its_light_in_the_window(picture, seen):
    """Proportional to brightness: two Gaussians multiplied, summed over the plane."""
    images, pins, brightness = seen
    size = picture.measure(images[:20], pins[:20])
    inner = np.hypot(*(pins[0] - 39.5).T) < 30
    together = 1 / (1 / SIGMA**2 + 1 / 1.5**2)
    wanted = brightness[:20] * 2 * np.pi * together
    ratio = size[:, inner] / wanted[:, inner]
    assert ratio.mean() == pytest.approx(1, abs=0.05)
    assert ratio.std() < 0.05


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


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.25, -0.4), (-0.5, 0.1), (1.3, 0.7)])
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


def test_drawing_a_larger_pin_gives_it_that_size(picture, pins):
    quiet = PinPicture(picture.background, picture.light, picture.sizes, np.zeros(2), picture.reach)
    inner = np.hypot(*(pins - 39.5).T) < 30
    for wanted in np.quantile(picture.sizes, [0.1, 0.5, 0.9]):
        sizes = np.full((1, len(pins)), wanted)
        image = quiet.draw(pins[None], sizes, np.random.default_rng(0))
        found = picture.measure(image, pins[None])[0, inner]
        assert found.mean() == pytest.approx(wanted, rel=0.05)


@pytest.mark.parametrize("sigma", [0.0, 1.0, 3.0, 8.0])
def test_even_noise_is_measured(pins, sigma):
    images, places, _ = frames(pins, 40, np.random.default_rng(4), (sigma**2, 0.0))
    noise = PinPicture.learn(images, places).noise
    found = np.sqrt(noise[0] + noise[1] * GROUND)
    assert found == pytest.approx(np.hypot(sigma, np.sqrt(1 / 12)), abs=0.6)
    assert (noise >= 0).all()


def test_pins_at_the_edge_and_outside_are_drawn_where_they_show(picture, pins):
    places = pins.copy()
    places[:4] = [[0, 0], [79, 79], [-50, 20], [200, 200]]
    sizes = np.full((1, len(pins)), picture.sizes[0])
    frame = picture.draw(places[None], sizes, np.random.default_rng(5))[0]
    assert frame[0, 0] > GROUND + 50
    assert frame[79, 79] > GROUND + 50
    assert abs(float(frame[15:26, :4].mean()) - GROUND) < 3
    gone = picture.measure(frame[None], places[None])[0]
    assert gone[2] == gone[3] == 0


def test_drawing_is_a_matter_of_the_rng(picture, pins):
    places = np.repeat(pins[None], 3, axis=0)
    sizes = np.full((3, len(pins)), picture.sizes[3])
    one, same, other = (
        picture.draw(places, sizes, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()
    assert (one[0] != one[1]).any(), "every frame has noise of its own"
    assert picture.draw(places[:0], sizes[:0], np.random.default_rng(1)).shape == (0, 80, 80)


def test_one_frame_is_enough_to_learn_and_few_hundred_are_looked_at(seen):
    images, pins, _ = seen
    one = PinPicture.learn(images[:1], pins[:1])
    assert np.isfinite(one.light).all()
    assert np.isfinite(one.background).all()
    same = PinPicture.learn(images, pins)
    np.testing.assert_array_equal(same.light, PinPicture.learn(images, pins).light)
