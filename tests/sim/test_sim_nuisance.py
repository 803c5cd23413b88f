"""Derivatives of a frame with respect to the camera, against closed forms and against optics."""

import numpy as np
import pytest

from tactibench import Indenter, Pose, Scene, SensorContext, UserError
from tactibench_sim.bounds import NUISANCES, derivatives
from tactibench_sim.mechanics.contact import tips_of
from tactibench_sim.sensor import TacTip127

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


def test_zoom_scales_places_and_sizes():
    h = 1e-4  # of a wide spot both move: I(p / z), and I ~ exp(-r^2 / (2 v z^2)) / v
    up, down = (spot(zoom=1 + d, variance=6 * (1 + d) ** 2) for d in (h, -h))
    up = 10 + (up - 10) * (1 + h) ** 2
    down = 10 + (down - 10) * (1 - h) ** 2
    (found,) = derivatives(spot(), ["zoom"])
    expected = (up - down) / (2 * h)
    assert np.abs(found - expected).max() < 2e-3 * np.abs(expected).max()


def test_names_and_counts():
    image = spot()
    assert derivatives(image, []).shape == (0, 41, 41)
    assert derivatives(image, NUISANCES).shape == (7, 41, 41)
    assert derivatives(image, ["blur", "blur"]).shape == (1, 41, 41)
    with pytest.raises(UserError, match=r"'smell'; it has shift, roll, .*blur\.$"):
        derivatives(image, ["roll", "smell"])


def test_shift_and_roll_are_those_of_the_sensors_discs():
    """Sharp discs sampled at pixel centres: the spline knows their slopes to about 0.15.

    Of a nuisance only the direction matters, its length drops out of the Schur complement.
    """
    sensor = TacTip127(SensorContext(np.random.SeedSequence(0)), vignetting=0.0)
    camera = sensor.renderer
    tips = sensor.tips(tips_of([Scene(Indenter.single(), Pose(1.0, -2.0, depth=3.0))]))
    x, y, radius = camera.project(tips)
    middle, h = (camera.optics.size - 1) / 2, 1e-4
    moves = {
        "x": (np.ones_like(x), np.zeros_like(y)),
        "y": (np.zeros_like(x), np.ones_like(y)),
        "roll": (-(y - middle), x - middle),
    }
    found = derivatives(camera.clean(tips)[0], ["shift", "roll"])
    for slope, (dx, dy) in zip(found, moves.values(), strict=True):
        up, down = (camera.clean_discs(x + s * dx, y + s * dy, radius)[0] for s in (h, -h))
        expected = (up - down) / (2 * h)
        cosine = (slope * expected).sum() / np.sqrt((slope**2).sum() * (expected**2).sum())
        assert cosine > 0.98
        assert np.linalg.norm(slope) == pytest.approx(np.linalg.norm(expected), rel=0.1)
