"""Grey, colour and black-and-white frames; parameters; individuals."""

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import correlate1d

from tactibench import UserError
from tactibench_sim.hooks import OPTICAL, tactibench_sensors
from tactibench_sim.instances import SPREAD, Spread, lost_pins, perturb
from tactibench_sim.optics.camera import Optics, optics_from
from tactibench_sim.optics.noise import Noise, streams
from tactibench_sim.optics.renderer import Renderer, glare
from tactibench_sim.sensor import TACTIP_127, TACTIP_331

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


def test_every_parameter_sets_its_field():
    nominal = TACTIP_127.optics
    (spec,) = [s for s in tactibench_sensors() if s.name == TACTIP_127.name]
    parameters = spec.parameters[-len(OPTICAL) :]
    assert optics_from(nominal, {p.name: p.default for p in parameters}) == nominal
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
    everything = set(flat(nominal)) - {"noise"}
    assert reached == everything
    with pytest.raises(TypeError, match="foo"):
        optics_from(nominal, {"foo": 1})


@pytest.mark.parametrize("preset", [TACTIP_127, TACTIP_331])
def test_the_defaults_that_are_listed_are_the_presets(preset):
    assert optics_from(Optics(), {p.name: p.default for p in OPTICAL}) == Optics()
    (spec,) = [s for s in tactibench_sensors() if s.name == preset.name]
    camera = spec.parameters[-len(OPTICAL) :]
    assert [p.name for p in camera] == [p.name for p in OPTICAL]
    assert optics_from(Optics(), {p.name: p.default for p in camera}) == preset.optics
    assert spec.settings({})["pin_length"] == preset.pin_length_mm


def test_presets_are_frozen_and_json():
    for preset in (TACTIP_127, TACTIP_331):
        with pytest.raises(dataclasses.FrozenInstanceError):
            preset.optics.focal = 2.0
        told = dataclasses.asdict(preset)
        assert json.loads(json.dumps(told)) == told
        assert preset.name == f"tactip-{preset.pins}"


@given(st.integers(1, 10**9))
def test_an_individual_is_within_its_ranges_and_always_the_same(instance):
    nominal = TACTIP_331.optics
    optics, length = perturb(nominal, 2.0, instance)
    assert (optics, length) == perturb(nominal, 2.0, instance)
    assert optics != nominal
    assert abs(length - 2.0) <= SPREAD.pin_length_mm
    relative = {"focal", "marker_radius_mm", "brightness", "background"}
    for field in dataclasses.fields(Spread):
        if field.name == "pin_length_mm":
            continue
        was, now = getattr(nominal, field.name), getattr(optics, field.name)
        by = getattr(SPREAD, field.name) * (was if field.name in relative else 1)
        assert abs(now - was) <= by + 1e-12
        assert now != was
    touched = {f.name for f in dataclasses.fields(Spread)}
    for field in dataclasses.fields(Optics):
        if field.name not in touched:
            assert getattr(optics, field.name) == getattr(nominal, field.name)


def test_the_nominal_sensor_is_instance_0_and_individuals_differ():
    nominal = Optics()
    assert perturb(nominal, 2.0, 0) == (nominal, 2.0)
    several = {perturb(nominal, 2.0, n) for n in range(50)}
    assert len(several) == 50
    focal = np.array([perturb(nominal, 2.0, n)[0].focal for n in range(1, 400)]) / nominal.focal
    assert focal.mean() == pytest.approx(1, abs=0.003)
    assert np.ptp(focal) == pytest.approx(0.04, abs=0.002)
    extreme = Optics(vignetting=1.0, edge_px=0.1)
    for n in range(1, 50):
        made, length = perturb(extreme, 0.0, n)
        assert 0 <= made.vignetting <= 1
        assert made.edge_px > 0
        assert length >= 0


@given(st.integers(0, 1000), st.floats(0, 0.9))
def test_lost_pins_are_the_individuals(instance, share):
    lost = lost_pins(127, share, instance)
    assert lost.sum() == round(127 * share)
    assert (lost == lost_pins(127, share, instance)).all()
    assert (lost <= lost_pins(127, min(1.0, share + 0.1), instance)).all()
    if share > 0.1:
        assert (lost != lost_pins(127, share, instance + 1)).any()


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


@pytest.mark.parametrize("wrong", [{"glare_scatter": -0.1}, {"glare_seed": -1}])
def test_wrong_glare_is_refused(wrong):
    with pytest.raises(UserError, match="glare_"):
        Optics(**wrong)
