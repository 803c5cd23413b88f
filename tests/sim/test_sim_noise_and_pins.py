"""Noise: the stream against numpy's, the normal values, what variance states; where pins stand."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from tactibench_sim import (
    HEXAGON,
    RINGS,
    TACTIPS,
    Noise,
    Optics,
    Renderer,
    expose,
    layout,
    normal_table,
    pixels,
    project,
    sfc64,
    streams,
)

SEED = np.random.SeedSequence(3)
NOTHING = np.empty((1, 0))
words = st.integers(0, 2**64 - 1)


def exposed(grey, press=0, noise=Noise(), seed=SEED):  # noqa: B008 frozen
    """uint8 of a float32 array."""
    state = streams(seed, press, 1)[0]
    sfc64(state, np.empty(12, np.uint64))
    out = np.empty(grey.size, np.uint8)
    expose(grey.ravel().astype(np.float32), state, noise.shot, noise.read, normal_table(), out)
    return out.reshape(grey.shape)


@given(words, words, words, words, st.integers(1, 300))
def test_the_stream_is_numpys_sfc64(a, b, c, counter, count):
    state = np.array([a, b, c, counter], dtype=np.uint64)
    theirs = np.random.SFC64(0)
    theirs.state = {**theirs.state, "state": {"state": state.copy()}}
    ours = np.empty(count, np.uint64)
    sfc64(state, ours)
    assert (ours == theirs.random_raw(count)).all()
    assert (state == theirs.state["state"]["state"]).all()


def test_the_table_is_a_standard_normal():
    table = normal_table().astype(float)
    assert table.mean() == pytest.approx(0, abs=1e-9)
    assert table.var() == pytest.approx(1, abs=1e-7)
    assert stats.kurtosis(table) == pytest.approx(0, abs=0.002)
    assert (np.diff(table) > 0).all()
    assert 4.2 < table.max() == -table.min() < 4.5
    far = np.array([1.0, 2.0, 3.0, 4.0])
    beyond = (table[None] > far[:, None]).mean(axis=1)
    assert beyond == pytest.approx(stats.norm.sf(far), rel=0.002, abs=0.5 / 65_536)


@pytest.mark.parametrize(
    "noise", [Noise(), Noise(read=0.7, full_well=1e9), Noise(read=4.0, full_well=2000.0)]
)
@pytest.mark.parametrize("level", [0.0, 0.5, 1.0, 2.0, 16.0, 90.37, 200.5, 250.0, 255.0])
def test_noise_has_the_variance_that_is_stated(noise, level):
    frames = [exposed(np.full((128, 128), level), k, noise).astype(float) for k in range(32)]
    seen = np.stack(frames) - level
    count = seen.size
    told = float(pixels(noise, np.array([level]))[1][0])
    chance = stats.kurtosis(seen, axis=None) + 2  # of the variance of so many pixels
    assert seen.var() == pytest.approx(told, rel=4.5 * np.sqrt(chance / count) + 0.013)
    if not 3 * np.sqrt(told) < level < 255 - 3 * np.sqrt(told):
        return  # clipped
    assert seen.var() == pytest.approx(told, rel=4.5 * np.sqrt(2 / count) + 2e-3)
    assert seen.mean() == pytest.approx(0, abs=4 * np.sqrt(told / count) + 3e-3)
    if noise.read > 1 and 40 < level < 220:
        assert stats.kurtosis(seen, axis=None) == pytest.approx(0, abs=0.02)
        beyond = (abs(seen) > 3 * np.sqrt(told)).mean()
        assert beyond == pytest.approx(2 * stats.norm.sf(3), rel=0.35)  # whole grey levels


@pytest.mark.parametrize("level", [0.5, 1.0, 3.0, 100.0, 252.0, 254.5])
def test_the_slope_of_a_pixel_is_that_of_its_mean(level):
    noise, step = Noise(), 0.4
    slope, _ = pixels(noise, np.array([level]))
    low, high = (
        np.mean([exposed(np.full((128, 128), at), k, noise).mean() for k in range(32)])
        for at in (level - step, level + step)
    )  # the same noise: only what is clipped differs
    assert (high - low) / (2 * step) == pytest.approx(float(slope[0]), abs=0.01)


def test_neighbours_presses_and_seeds_are_independent():
    noise, level = Noise(read=6.0, full_well=1e9), 100.0
    seen = np.stack([exposed(np.full((128, 128), level), k, noise) for k in range(24)]) - level
    seen = (seen - seen.mean()) / seen.std()
    limit = 4.5 / np.sqrt(seen.size)
    for lag in (1, 2, 3, 4, 5, 127, 128, 129, 1024):
        flat = seen.reshape(24, -1)
        assert abs((flat[:, lag:] * flat[:, :-lag]).mean()) < limit * 1.05
        square = flat**2 - 1
        assert abs((square[:, lag:] * square[:, :-lag]).mean()) < 2.1 * limit
    table = np.corrcoef(seen.reshape(24, -1)) - np.eye(24)
    assert abs(table).max() < 4.5 / 128
    assert abs(seen.mean(axis=0)).max() < 5.2 / np.sqrt(24)  # no pixel has a habit
    other = exposed(np.full((128, 128), level), 0, noise, np.random.SeedSequence(4)) - level
    assert abs(np.corrcoef(other.ravel(), seen[0].ravel())[0, 1]) < 4.5 / 128


@given(st.integers(0, 2**40), st.integers(0, 2**40), st.integers(0, 5))
def test_every_press_has_a_stream_of_its_own(a, b, key):
    seed = np.random.SeedSequence(5, spawn_key=(1, key))
    one, other = (streams(seed, press, 1)[0] for press in (a, b))
    assert (one == other).all() == (a == b)
    assert (streams(seed, a, 3)[2] == streams(seed, a + 2, 1)[0]).all()
    assert (
        seed.generate_state(1) == np.random.SeedSequence(5, spawn_key=(1, key)).generate_state(1)
    ).all()


def test_without_noise_frames_are_rounded_and_its_variance_is_rounding():
    grey = np.array([0.0, 0.4, 0.6, 100.0, 254.7, 300.0, -3.0], dtype=np.float32)
    camera = Renderer(Optics(size=32, noise=Noise(on=False)))
    assert (
        camera.disc_frames(NOTHING, NOTHING, NOTHING, streams(SEED, 0, 1))
        == camera.disc_frames(NOTHING, NOTHING, NOTHING)
    ).all()
    out = np.empty(7, np.uint8)
    expose(grey, np.zeros(4, np.uint64), 0.0, 0.0, normal_table(), out)
    assert out.tolist() == [0, 0, 1, 100, 255, 255, 0]
    assert camera.variance(grey[1:5]) == pytest.approx(np.full(4, 1 / 12))


@pytest.mark.parametrize("output", ["grey", "rgb"])
def test_variance_of_what_a_model_takes_in(output):
    from tactibench import Frame, Pose, gray_frames

    optics = Optics(size=128, output=output, vignetting=1.0, background=30.0, red=0.6)
    camera = Renderer(optics)
    x, y, radius = np.array([[[40.0]], [[90.0]], [[25.0]]])
    clean = camera.clean_discs(x, y, radius)[0]
    frames = [
        Frame(camera.disc_frames(x, y, radius, streams(SEED, k, 1))[0], 0.0, Pose())
        for k in range(200)
    ]
    off = gray_frames(frames, 128) - clean
    told = camera.variance(clean)
    assert off.mean() == pytest.approx(0, abs=0.01)
    for part in (clean > 140, (clean < 60) & (clean > 20)):
        assert off.var(axis=0)[part].mean() == pytest.approx(told[part].mean(), rel=0.01)


def seen_at_rest(pins, size=1):
    preset = TACTIPS[pins]
    tips = (19.0 - preset.pin_length_mm) * layout(pins)
    optics = dataclasses.replace(preset.optics, size=size)
    return project(optics, tips, optics.camera_distance_mm - 20.0)


def test_pins_at_rest_are_seen_where_the_real_ones_are():
    """The derivation of the polar angles: projected back they give the radii of the real frames."""
    x, y, _ = seen_at_rest(331)
    rings = np.unique(np.hypot(x, y).round(9))
    assert rings == pytest.approx(np.array(RINGS), abs=1e-9)
    x, y, _ = seen_at_rest(127)
    pitch = np.array([0, 1, np.sqrt(3), 2])
    told = HEXAGON[0] * pitch + HEXAGON[1] * pitch**3 + HEXAGON[2] * pitch**5
    assert np.unique(np.hypot(x, y).round(9))[:4] == pytest.approx(told, abs=1e-9)


@pytest.mark.parametrize("pins", [127, 331])
def test_layout_is_a_centred_unit_pattern_that_fits_the_frame(pins):
    b = layout(pins)
    assert b.shape == (pins, 3)
    assert np.linalg.norm(b, axis=1) == pytest.approx(np.ones(pins), abs=1e-14)
    assert tuple(b[0]) == (0, 0, 1)
    assert abs(b[:, :2].mean(axis=0)).max() < 1e-12
    x, y, radius = seen_at_rest(pins, 128)
    assert (np.stack([x, y]) - radius > 0).all()
    assert (np.stack([x, y]) + radius < 127).all()
    turned = b[:, [0]] * np.array([[0.5, 0.75**0.5]]) + b[:, [1]] * np.array([[-(0.75**0.5), 0.5]])
    gap = np.linalg.norm(turned[:, None] - b[None, :, :2], axis=2).min(axis=1)
    assert gap.max() < 1e-12  # sixfold
