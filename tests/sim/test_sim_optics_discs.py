"""Discs to grey levels: centroids, areas, overlaps, what does not move."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from tactibench_sim import Optics, Renderer, gaussian_taps, glare, streams, vignetting

FLAT = {"vignetting": 0.0, "background": 0.0, "brightness": 1.0}


def cover(x, y, radius, size=64, **optics):
    """(S, size, size) cover 0..1 of discs (S, P)."""
    arrays = (np.atleast_2d(np.array(a, dtype=float, order="C")) for a in (x, y, radius))
    return Renderer(Optics(size=size, **(FLAT | optics))).clean_discs(*arrays)


@pytest.mark.parametrize("edge", [0.7, 1.0, 1.5, 3.0])
@pytest.mark.parametrize("radius", [0.8, 1.0, 1.3, 2.1, 5.0])
def test_centroid_of_a_disc(radius, edge):
    centre = np.random.default_rng(0).uniform(15, 25, (300, 2))
    image = cover(centre[:, :1], centre[:, 1:], np.full((300, 1), radius), 41, edge_px=edge)
    row, column = np.mgrid[:41, :41]
    mass = image.sum(axis=(1, 2))
    x, y = (image * column).sum(axis=(1, 2)) / mass, (image * row).sum(axis=(1, 2)) / mass
    error = np.stack([x, y], axis=1) - centre
    assert abs(error).max() < 0.01
    assert np.sqrt((error**2).mean()) < 0.004


@pytest.mark.parametrize("edge", [0.5, 1.0, 4.0])
def test_a_large_disc_has_its_area_and_its_rim(edge):
    image = cover(60.3, 50.7, 20.0, 128, edge_px=edge)[0]
    # the smoothstep's derivative has variance edge^2 / 5 around the rim
    assert image.sum() == pytest.approx(np.pi * (20.0**2 + edge**2 / 5), rel=1e-4)
    assert image[51, 60] == 1.0
    assert image[51, 86] == 0.0
    profile = image[51, 60:].round(12)
    assert (np.diff(profile) <= 0).all()
    half = np.interp(-0.5, -profile[10:30], np.arange(70, 90))
    assert half == pytest.approx(60.3 + np.sqrt(400 - 0.3**2), abs=0.1)


def test_discs_outside_the_frame_leave_no_trace_and_half_discs_half():
    far = [-500.0, 63.0, 30.0, 1e300, -np.inf], [30.0, 4000.0, -8.0, 3.0, 3.0]
    assert (cover(*far, np.full(5, 2.0)) == 0).all()
    half, whole = cover(-0.5, 30.0, 6.0)[0], cover(31.5, 30.0, 6.0)[0]
    assert half.sum() == pytest.approx(whole.sum() / 2, rel=1e-12)
    corner = cover(63.5, 63.5, 6.0)[0]
    assert corner.sum() == pytest.approx(whole.sum() / 4, rel=1e-2)


def test_overlapping_discs_saturate():
    three = cover(np.full((1, 3), 30.0), np.full((1, 3), 30.0), np.full((1, 3), 4.0))
    assert three.max() == 1.0
    apart, near = (cover([[20.0, x]], [[20.0, 20.0]], [[4.0, 4.0]])[0] for x in (40.0, 22.0))
    assert near.sum() < 0.7 * apart.sum()
    assert near.max() == 1.0


def test_other_frames_of_a_batch_and_threads_do_not_matter():
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-5, 70, (2, 40, 30))
    radius = rng.uniform(0.5, 4, (40, 30))
    camera = Renderer(Optics(size=64, blur_px=0.7, glare=0.5))
    states = streams(np.random.SeedSequence(4), 7, 40)
    together = camera.disc_frames(x, y, radius, states)

    def one(k):
        return camera.disc_frames(x[k : k + 1], y[k : k + 1], radius[k : k + 1], states[k : k + 1])[
            0
        ]

    with ThreadPoolExecutor(4) as pool:
        alone = np.stack(list(pool.map(one, range(40))))
    assert (together == alone).all()
    assert (
        camera.disc_frames(x, y, radius, states) == together
    ).all()  # states are left as they were
    assert (
        camera.clean_discs(x, y, radius)[3] == camera.clean_discs(x[3:4], y[3:4], radius[3:4])
    ).all()


def test_vignetting_is_cos4_of_the_angle_in_air():
    optics = Optics(size=101, focal=0.8, vignetting=1.0)
    assert vignetting(optics)[50, 50] == 1.0
    angle = np.arctan(np.hypot(30, 40) / 101 / 0.8)
    assert vignetting(optics)[20, 90] == pytest.approx(np.cos(angle) ** 4)
    part = Optics(size=101, focal=0.8, vignetting=0.25)
    assert vignetting(part)[20, 90] == pytest.approx(1 - 0.25 * (1 - np.cos(angle) ** 4))
    fish = Optics(size=101, focal=0.5, vignetting=1.0, lens="fisheye")
    assert vignetting(fish)[50, 90] == pytest.approx(np.cos(40 / 101 / 0.5) ** 4)
    assert (vignetting(Optics(vignetting=0.0)) == 1).all()
    lit = Renderer(optics).clean_discs(*np.array([[[90.0]], [[20.0]], [[5.0]]]))[0]
    assert lit[20, 90] == pytest.approx(208 * np.cos(angle) ** 4)


@pytest.mark.parametrize("sigma", [0.3, 1.0, 2.5])
def test_blur_is_a_gaussian(sigma):
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-2, 66, (2, 1, 50))
    radius = np.full((1, 50), 2.0)
    sharp = cover(x, y, radius)[0]
    blurred = cover(x, y, radius, blur_px=sigma)[0]
    told = gaussian_filter(sharp, sigma, mode="nearest", radius=len(gaussian_taps(sigma)) // 2)
    assert blurred == pytest.approx(told, abs=1e-12)


def test_glare_is_a_ring_of_arcs():
    optics = Optics(size=200, glare=0.8, leds=5, glare_start_deg=20.0, glare_radius=0.4)
    image = glare(optics)
    assert image.max() == pytest.approx(0.8)
    row, column = np.nonzero(image > 0.4)
    away = np.hypot(column - 99.5, row - 99.5) / 200
    assert away.mean() == pytest.approx(0.4, abs=0.002)
    assert np.ptp(away) == pytest.approx(optics.glare_width, abs=0.012)
    azimuth = np.degrees(np.arctan2(row - 99.5, column - 99.5))
    beside = (azimuth - 20.0 + 36) % 72 - 36
    assert abs(beside).max() <= 13.5
    assert np.bincount(((azimuth - 20.0 + 36) % 360 // 72).astype(int)).min() > 50
    assert (glare(Optics()) == 0).all()
    assert (glare(Optics(glare=1.0, leds=0)) == 0).all()
    seen = Renderer(optics).clean_discs(np.empty((1, 0)), np.empty((1, 0)), np.empty((1, 0)))[0]
    assert ((seen > 100) == (image > 0.45)).mean() > 0.99
