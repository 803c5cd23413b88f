"""Grey, colour and black-and-white frames; parameters; individuals."""

import dataclasses

import numpy as np
import pytest
from scipy.ndimage import correlate1d

from tactibench_sim import (
    TACTIP_127,
    TACTIP_331,
    Noise,
    Optics,
    Renderer,
    glare,
    optics_from,
    parameters_of,
    streams,
)

DISCS = np.array([[[20.0, 44.0]], [[30.0, 36.0]], [[6.0, 5.0]]])
SEED = np.random.SeedSequence(1)


def frame(press=0, **optics):
    camera = Renderer(Optics(size=64, **optics))
    return camera.disc_frames(*DISCS, streams(SEED, press, 1))[0]


def test_colour_is_light_by_channel_with_noise_of_its_own():
    light = {"red": 0.5, "green": 1.0, "blue": 0.25, "vignetting": 0.0}
    quiet = frame(output="rgb", noise=Noise(on=False), **light)
    assert quiet.shape == (64, 64, 3)
    assert quiet.dtype == np.uint8
    assert quiet[30, 20].tolist() == [104, 208, 52]
    assert quiet[0, 0].tolist() == [8, 16, 4]
    loud = frame(output="rgb", red=1.0, green=1.0, blue=1.0, noise=Noise(read=5.0)).astype(float)
    corner = loud[:12, :12].reshape(-1, 3)
    assert abs(np.corrcoef(corner.T) - np.eye(3)).max() < 0.3
    grey = frame(noise=Noise(on=False))
    assert (
        frame(output="rgb", red=1.0, green=1.0, blue=1.0, noise=Noise(on=False)) == grey[..., None]
    ).all()


def test_black_and_white_is_the_adaptive_threshold_of_the_grey_frame():
    optics = {"threshold_side": 21 / 64, "threshold_grey": 5.0}
    grey, bw = frame(), frame(output="bw", **optics)
    assert set(np.unique(bw)) == {0, 255}
    sigma = 0.3 * ((21 - 1) * 0.5 - 1) + 0.8  # OpenCV's Gaussian of a block of 21
    taps = np.exp(-(np.arange(-10, 11) ** 2) / (2 * sigma**2))
    mean = grey.astype(float)
    for axis in range(2):
        mean = correlate1d(mean, taps / taps.sum(), axis=axis, mode="nearest")
    clear = abs(grey - mean - 5.0) > 1.0  # OpenCV rounds the mean
    assert ((bw > 0) == (grey > mean + 5.0))[clear].all()
    assert clear.mean() > 0.7
    assert bw[30, 20] == 255


def test_the_real_blocks_are_61_of_360_pixels():
    side = Optics().threshold_side
    assert [2 * round((side * size - 1) / 2) + 1 for size in (360, 256, 128)] == [61, 43, 21]


@pytest.mark.parametrize("nominal", [TACTIP_127, TACTIP_331], ids=("127", "331"))
def test_every_parameter_sets_its_field(nominal):
    parameters = list(parameters_of(nominal))
    assert optics_from(Optics(), {p.name: p.default for p in parameters}) == nominal
    flat = lambda o: {**dataclasses.asdict(o), **dataclasses.asdict(o)["noise"]}  # noqa: E731
    reached = set()
    for p in parameters:
        if p.choices:
            other = next(c for c in p.choices if c != p.default)
        elif isinstance(p.default, bool):
            other = not p.default
        elif isinstance(p.default, int):
            other = p.default + 1
        else:
            other = min(p.default * 1.01 + 0.01, p.high)
            other = p.default - 0.01 if other == p.default else other
        changed = flat(optics_from(nominal, {p.name: p.check(other)}))
        differ = {k for k, v in flat(nominal).items() if changed[k] != v} - {"noise"}
        assert len(differ) == 1, p.name
        assert changed[differ.copy().pop()] == other
        reached |= differ
    assert reached == set(flat(nominal)) - {"noise"}
    with pytest.raises(TypeError, match="foo"):
        optics_from(nominal, {"foo": 1})


def test_irregular_glare_is_drawn_from_its_seed():
    def lit(**more):
        return glare(Optics(size=256, glare=1.0, **more))

    regular = lit()
    assert np.array_equal(lit(glare_seed=5), regular)  # without scatter the seed says nothing
    one, again, other = (lit(glare_scatter=0.7, glare_seed=s) for s in (1, 1, 2))
    assert np.array_equal(one, again)
    assert not np.array_equal(one, other)
    assert not np.array_equal(one, regular)
    assert one.max() <= 1
    assert one.min() == 0
    assert not glare(Optics(size=64, glare_scatter=1.0)).any()


def test_little_scatter_is_nearly_regular():
    regular, nearly = (glare(Optics(size=256, glare=1.0, glare_scatter=s)) for s in (0.0, 1e-6))
    assert np.abs(regular - nearly).max() < 1e-2
    # six arcs of 27 deg, whose thickness falls off as a parabola: two thirds of it in the mean
    area = 6 * np.radians(27.0) * 0.47 * 2 / 3 * 0.017 * 256**2
    assert regular.sum() == pytest.approx(area, rel=0.05)
