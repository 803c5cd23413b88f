"""Pins, camera, discs, noise."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage
from scipy.optimize import least_squares, linear_sum_assignment

from tactibench_sim.noise import Noise
from tactibench_sim.optics import Camera
from tactibench_sim.pins import layout

SIZES = pytest.mark.parametrize("size", [128, 256, 360])
REAL = Path(
    os.environ.get(
        "TACTIBENCH_TACVGNN",
        Path(__file__).resolve().parents[2].parent / "shared" / "data" / "tac-vgnn",
    )
)


@SIZES
def test_centroid_of_a_disc(size):
    camera = Camera(size=size)
    rng = np.random.default_rng(0)
    centre = rng.uniform(20, size - 21, (500, 2))
    radius = camera.focal * size * camera.pin_radius_mm / 52.0
    image = camera.splat(centre[:, :1], centre[:, 1:], np.full((500, 1), radius))
    row, column = np.mgrid[:size, :size]
    mass = image.sum(axis=(1, 2))
    x, y = (image * column).sum(axis=(1, 2)) / mass, (image * row).sum(axis=(1, 2)) / mass
    error = np.stack([x, y], axis=1) - centre
    assert np.sqrt((error**2).mean()) < 0.01
    assert abs(error).max() < 0.02


def test_a_large_disc_has_its_area_and_its_rim():
    camera = Camera(size=128)
    image = camera.splat(np.array([[60.3]]), np.array([[50.7]]), np.array([[20.0]]))[0]
    assert image.sum() == pytest.approx(np.pi * (20.0**2 + 0.2), rel=2e-3)
    assert image[51, 60] == 1.0
    assert image[51, 82] == 0.0


def test_discs_outside_the_frame_leave_no_trace_and_half_discs_half():
    camera = Camera(size=64)
    far = camera.splat(np.array([[-500.0, 63.0]]), np.array([[30.0, 4000.0]]), np.full((1, 2), 2.0))
    assert (far == 0).all()
    half = camera.splat(np.array([[-0.5]]), np.array([[30.0]]), np.array([[6.0]]))[0]
    whole = camera.splat(np.array([[31.5]]), np.array([[30.0]]), np.array([[6.0]]))[0]
    assert half.sum() == pytest.approx(whole.sum() / 2, rel=1e-12)


def test_overlapping_discs_do_not_exceed_one():
    camera = Camera(size=64)
    image = camera.splat(np.full((1, 3), 30.0), np.full((1, 3), 30.0), np.full((1, 3), 4.0))
    assert image.max() == 1.0


def test_other_frames_of_a_batch_do_not_matter():
    camera, rng = Camera(size=64), np.random.default_rng(1)
    x, y = rng.uniform(-5, 70, (2, 20, 30))
    radius = rng.uniform(0.5, 4, (20, 30))
    together = camera.splat(x, y, radius)
    for k in range(20):
        alone = camera.splat(x[k : k + 1], y[k : k + 1], radius[k : k + 1])
        assert (together[k] == alone[0]).all()


def test_the_camera_looks_out_with_x_right_and_y_down():
    camera = Camera(size=101)
    x, y, radius = camera.project(np.array([[0, 0, 17.0], [1, 0, 17], [0, 1, 17], [0, 0, 5]]))
    assert (x[0], y[0]) == (50, 50)
    assert x[1] > 50
    assert y[1] == 50
    assert y[2] > 50
    assert x[2] == 50
    assert radius[3] / radius[0] == pytest.approx(52 / 40)


@pytest.mark.parametrize("pins", [127, 331])
def test_layout_is_a_centred_unit_pattern_that_fits_the_frame(pins):
    b = layout(pins)
    assert b.shape == (pins, 3)
    assert np.linalg.norm(b, axis=1) == pytest.approx(np.ones(pins), abs=1e-14)
    assert tuple(b[0]) == (0, 0, 1)
    assert abs(b[:, :2].mean(axis=0)).max() < 1e-12
    x, y, radius = Camera().project(17 * b)
    assert (np.stack([x, y]) - radius > 0).all()
    assert (np.stack([x, y]) + radius < 127).all()
    turned = b[:, [0]] * np.array([[0.5, 0.75**0.5]]) + b[:, [1]] * np.array([[-(0.75**0.5), 0.5]])
    gap = np.linalg.norm(turned[:, None] - b[None, :, :2], axis=2).min(axis=1)
    assert gap.max() < 1e-12  # sixfold


@pytest.mark.parametrize(("pins", "size"), [(127, 256), (331, 360)])
def test_layout_against_the_real_rest_frame(pins, size):
    path = REAL / str(pins) / "model_surface2d" / "frames_bw" / "init_0.png"
    if not path.is_file():
        pytest.skip(f"the real rest frame {path} is not there")
    import cv2

    blobs, _ = ndimage.label(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) > 127)
    numbers = np.arange(1, blobs.max() + 1)
    area = ndimage.sum_labels(blobs > 0, blobs, numbers)
    numbers = numbers[(area > 5) & (area < 130)]  # the rest is the rim's glare and specks
    seen = np.array(ndimage.center_of_mass(blobs > 0, blobs, numbers))[:, ::-1]
    assert len(seen) == pins
    x, y, _ = Camera(size=size).project(17 * layout(pins))
    ours = np.stack([x, y], axis=1)

    def moved(p):  # the real frames are shifted, turned by up to 2 deg and resized unevenly
        c, s = np.cos(p[2]), np.sin(p[2])
        away = (ours - (size - 1) / 2) @ np.array([[c, s], [-s, c]])
        return away * [1 + p[3], 1 - p[3]] + (size - 1) / 2 + p[:2]

    p = np.array([*(seen.mean(axis=0) - (size - 1) / 2), 0.0, 0.0])
    for _ in range(5):
        gap = np.linalg.norm(moved(p)[:, None] - seen[None], axis=2)
        _, pair = linear_sum_assignment(gap)
        p = least_squares(lambda p, pair=pair: (moved(p) - seen[pair]).ravel(), p).x
    gap = np.linalg.norm(moved(p) - seen[pair], axis=1)
    assert np.sqrt((gap**2).mean()) < 0.003 * size
    assert gap.max() < 0.01 * size
    assert abs(p[2]) < np.radians(3)
    assert abs(p[3]) < 0.02


def test_noise_has_the_variance_it_states():
    noise = Noise(read=1.5, full_well=4000.0)
    clean = np.repeat(np.array([40.0, 200.0], dtype=np.float32), 20_000).reshape(2, 100, 200)
    seen = noise.expose(clean, np.random.SeedSequence(3), 0).astype(float) - clean
    told = noise.variance(np.array([40.0, 200.0]))
    assert seen.mean(axis=(1, 2)) == pytest.approx([0, 0], abs=0.08)
    assert seen.var(axis=(1, 2)) == pytest.approx(told, rel=0.04)


@settings(max_examples=20)
@given(st.integers(0, 2**40), st.integers(0, 2**40))
def test_every_press_has_a_stream_of_its_own(a, b):
    noise, clean = Noise(), np.full((8, 8), 100.0, dtype=np.float32)
    seed = np.random.SeedSequence(5, spawn_key=(1, 2))
    same = (noise.expose(clean, seed, a) == noise.expose(clean, seed, b)).all()
    assert same == (a == b)
    assert (clean == 100).all()
