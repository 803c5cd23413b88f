"""The deviance of two contacts from one, against closed forms and a search by brute force."""

import itertools

import numpy as np
import pytest

from tactibench import Indenter, Pose, Scene, SensorContext, UserError
from tactibench_sim import NUISANCES, TacTip127, Tips, deviance, tips_of

HEIGHT, WIDTH, NOISE, PX_PER_MM = 20.0, 4.0, 2.0, 5.0


def blobs(tips):
    """A sensor that adds up Gaussian spots, as bright as contacts are deep."""
    rows, columns = np.mgrid[:64, :64] - 31.5
    out = np.full((len(tips), 64, 64), 7.0)
    for k in range(tips.depth.shape[1]):
        x, y = (PX_PER_MM * tips.xy[:, k, axis, None, None] for axis in (0, 1))
        spot = np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * WIDTH**2))
        out += HEIGHT * np.maximum(tips.depth[:, k], 0.0)[:, None, None] * spot
    return out


def white(image, noise=NOISE):
    return np.full(image.shape, noise**2)


def pair(spacing, depth=1.0, middle=(0.3, -0.2)):
    x, y = middle
    xy = np.array([[[x - spacing / 2, y], [x + spacing / 2, y]]])
    return Tips(xy, np.full((1, 2), depth), np.full(1, 3.0))


def test_two_near_spots_differ_from_one_by_the_fourth_power_of_their_spacing():
    """With f a spot of width w, f(x - s/2) + f(x + s/2) = 2 f + s^2 / 4 f_xx. The part of f_xx that
    no brightness explains has the square pi / (2 w^2), so D = (A s^2 / 4)^2 pi / (2 w^2) / v.
    """
    for spacing in (0.05, 0.1, 0.2):
        s = PX_PER_MM * spacing
        expected = (HEIGHT * s**2 / 4) ** 2 * np.pi / (2 * WIDTH**2) / NOISE**2
        found = deviance(pair(spacing), blobs, white)
        assert found == pytest.approx(expected, rel=0.03 * (spacing / 0.2) ** 2 + 1e-3)


def test_one_contact_differs_from_one_by_nothing():
    assert deviance(pair(0.0), blobs, white) < 1e-12
    alone = pair(3.0)
    alone.depth[0, 1] = -0.5
    assert deviance(alone, blobs, white) == 0.0


def test_what_looks_like_a_property_of_the_camera_does_not_count():
    known = deviance(pair(1.0), blobs, white)
    for k in range(1, len(NUISANCES) + 1):
        unknown = deviance(pair(1.0), blobs, white, NUISANCES[:k])
        assert unknown <= known * (1 + 1e-6) + 1e-9
        known = unknown
    # a spot that is wider in x: all of it but the part that a blur makes remains
    assert deviance(pair(0.1), blobs, white, ["blur"]) == pytest.approx(
        deviance(pair(0.1), blobs, white) / 2, rel=0.02
    )
    with pytest.raises(UserError, match="no nuisance 'smell'"):
        deviance(pair(1.0), blobs, white, ["smell"])


def test_no_single_press_on_a_grid_is_nearer():
    """A grid of 7 x 7 x 7 single presses, zoomed in on its best eight times."""
    one = TacTip127(SensorContext(np.random.SeedSequence(0)), size=64)
    pose = Pose(-2.0, 1.5, 110, depth=2.0)
    scene = Scene(Indenter.dual(2.0), pose)
    two = one.clean(tips_of([scene])).astype(float)[0]
    variance = one.renderer.variance(two)
    best, half = np.array([pose.x, pose.y, pose.depth]), 0.6
    for _ in range(8):
        steps = half * np.linspace(-1, 1, 7)
        places = best + np.array(list(itertools.product(steps, repeat=3)))
        single = Tips(places[:, None, :2], places[:, None, 2], np.full(len(places), 3.0))
        misfit = ((one.clean(single) - two) ** 2 / variance).sum(axis=(1, 2))
        best, least = places[misfit.argmin()], misfit.min()
        half *= 0.4
    assert one.deviance(scene) == pytest.approx(least, rel=1e-3)
