"""The camera: refraction and projection, discs to grey levels, formats and parameters."""

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import correlate1d, gaussian_filter
from scipy.optimize import brentq

from tactibench import UserError
from tactibench_sim import (
    TACTIPS,
    Noise,
    Optics,
    Renderer,
    blurred_disc,
    gaussian_taps,
    glare,
    optics_from,
    parameters_of,
    project,
    slope_per_mm,
    streams,
    vignetting,
)

AIR = {"gel_index": 1.0, "window_index": 1.0}
PATHS = st.tuples(
    st.floats(0.0, 40.0),
    st.floats(1.0, 60.0),
    st.floats(0.0, 10.0),
    st.floats(0.01, 40.0),
    st.floats(1.0, 2.0),
    st.floats(1.0, 2.0),
)


def shot(angle, air, window, gel, window_index, gel_index):
    """Where a ray that leaves the camera at this angle is after the three layers (Snell's law)."""
    inside = math.asin(math.sin(angle) / window_index), math.asin(math.sin(angle) / gel_index)
    return air * math.tan(angle) + window * math.tan(inside[0]) + gel * math.tan(inside[1])


@given(PATHS)
def test_ray_shooting_finds_the_same_angle(path):
    rho, layers = path[0], path[1:]
    high = math.atan2(rho, layers[0]) + 1e-9  # without refraction it would be less steep inside
    angle = brentq(lambda a: shot(a, *layers) - rho, 0.0, high, xtol=1e-15, rtol=1e-14)
    assert slope_per_mm(rho, *layers) * rho == pytest.approx(math.tan(angle), rel=1e-11, abs=1e-14)


@given(st.floats(-20, 20), st.floats(-20, 20), st.floats(35.1, 60), st.floats(0.2, 3))
def test_without_refraction_it_is_a_pinhole(x, y, z, focal):
    optics = Optics(focal=focal, **AIR)
    u, v, radius = project(optics, np.array([x, y, z]))
    scale = focal * 128 / z
    assert (u, v) == (
        pytest.approx(63.5 + scale * x, abs=1e-10),
        pytest.approx(63.5 + scale * y, abs=1e-10),
    )
    assert radius == pytest.approx(scale * optics.marker_radius_mm, rel=1e-12)


def test_a_fisheye_is_equidistant():
    optics = Optics(lens="fisheye", size=101, focal=0.5, **AIR)
    angles = np.radians([0.0, 10.0, 40.0, 70.0])
    points = 60.0 * np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=1)
    near = dataclasses.replace(optics, camera_distance_mm=25.0)
    x, y, _ = project(near, points)
    assert x == pytest.approx(50 + 0.5 * 101 * angles, abs=1e-10)
    assert y == pytest.approx(np.full(4, 50.0))


def test_magnification_by_refraction_reaches_the_index_and_changes_with_depth():
    def against_air(optics, z):
        """Size of a small thing on the axis, relative to the same camera in air."""
        point = np.array([1e-6, 0.0, z])
        middle = (optics.size - 1) / 2
        seen, plain = (
            project(o, point)[0] - middle for o in (optics, dataclasses.replace(optics, **AIR))
        )
        return seen / plain

    touching = Optics(camera_distance_mm=22.001, window_mm=0.001, gel_mm=22.0 - 0.0001)
    assert against_air(touching, 20.0) == pytest.approx(1.41, rel=1e-3)
    usual = Optics()
    apex, rim = against_air(usual, 52.0), against_air(usual, 40.0)
    assert apex == pytest.approx(52 / (33 + 2 / 1.49 + 17 / 1.41), rel=1e-6)
    assert 1.0 < rim < apex < 1.41


@given(st.floats(0.01, 16.0), st.floats(-math.pi, math.pi), st.sampled_from(["pinhole", "fisheye"]))
def test_a_discs_radius_is_the_transverse_magnification(rho, azimuth, lens):
    optics, h = Optics(lens=lens), 1e-5
    turned = azimuth + np.array([-h, h])
    points = np.stack([rho * np.cos(turned), rho * np.sin(turned), [45.0, 45.0]], axis=1)
    x, y, radius = project(optics, points)
    apart = math.hypot(x[1] - x[0], y[1] - y[0]) / (2 * h * rho)
    assert radius[0] / optics.marker_radius_mm == pytest.approx(apart, rel=1e-5)


def test_x_is_right_y_is_down_and_the_axis_can_be_elsewhere():
    points = np.array([[0, 0, 17.0], [1, 0, 17], [0, 1, 17]])
    x, y, _ = project(Optics(size=101), points, 35.0)
    assert (x[0], y[0]) == (50, 50)
    assert (x[1] > 50, y[1]) == (True, 50)
    assert (x[2], y[2] > 50) == (50, True)
    moved = project(
        Optics(size=101, principal_x=0.1, principal_y=-0.05, roll_deg=90.0), points, 35.0
    )
    assert moved[0] == pytest.approx(60.1 - (y - 50), abs=1e-10)  # 90 deg take x to y
    assert moved[1] == pytest.approx(44.95 + (x - 50), abs=1e-10)


def test_a_marker_outside_the_gel_is_refused():
    for z in (34.9, 0.0, -5.0, math.nan):
        with pytest.raises(UserError, match=r"not in the gel, which begins 35 mm"):
            project(Optics(), np.array([[0.0, 0.0, 50.0], [0.0, 0.0, z]]))


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


def blurred(radius, edge, x, y, size):
    """(size, size) means over pixels of a disc that a hemisphere of radius ``edge`` blurs."""
    angle = (np.arange(1000) + 0.5) * np.pi / 2000
    ring = edge * np.sin(angle)
    weight = 3 * np.cos(angle) ** 2 * np.sin(angle) * np.pi / 2000  # of the hemisphere's rings
    away = np.linspace(0, radius + edge, 600)[:, None]
    with np.errstate(all="ignore"):
        cosine = (away**2 + ring**2 - radius**2) / (2 * away * ring)
    inside = np.where(np.isnan(cosine), ring < radius, np.arccos(cosine.clip(-1, 1)) / np.pi)
    at = (np.arange(16 * size) + 0.5) / 16 - 0.5
    distance = np.hypot(*np.meshgrid(at - x, at - y))
    fine = np.interp(distance, away[:, 0], inside @ weight, right=0)
    return fine.reshape(size, 16, size, 16).mean(axis=(1, 3))


@pytest.mark.parametrize("edge", [0.7, 1.0, 1.5])
@pytest.mark.parametrize("radius", [0.1, 0.3, 0.6, 1.0, 1.17, 1.5, 2.0, 3.0, 5.0])
def test_a_disc_is_that_disc_blurred_with_all_its_light(radius, edge):
    places = 8 + np.random.default_rng(1).uniform(-0.5, 0.5, (40, 2))
    images = cover(*places.T[:, :, None], np.full((40, 1), radius), 17, edge_px=edge)
    light = images.sum(axis=(1, 2)) / (np.pi * radius**2)
    assert light.mean() == pytest.approx(1, abs=0.002)
    assert abs(light - 1).max() < (0.01 if edge >= 1 or radius >= 0.6 else 0.04)
    for image, place in zip(images[:4], places[:4], strict=True):
        true = blurred(radius, edge, *place, 17)
        most = 0.04 if radius > 1.2 * edge else 0.1 if radius > 0.5 * edge else 0.25
        assert abs(image - true).max() < most * true.max()


def test_the_profile_of_a_disc_grows_steadily():
    profiles = np.array([blurred_disc(r, 1.0) for r in np.arange(0.001, 3, 1e-4)])
    assert (np.diff(profiles[:, 0]) >= 0).all()
    assert abs(np.diff(profiles, axis=0)).max() < 3e-4  # no jump where small discs begin


@pytest.mark.parametrize("edge", [0.5, 1.0, 4.0])
def test_a_large_disc_has_its_area_and_its_rim(edge):
    image = cover(60.3, 50.7, 20.0, 128, edge_px=edge)[0]
    assert image.sum() == pytest.approx(np.pi * 20.0**2, rel=1e-4)
    assert (image[51, 60], image[51, 86]) == (1.0, 0.0)


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
        row = slice(k, k + 1)
        return camera.disc_frames(x[row], y[row], radius[row], states[row])[0]

    with ThreadPoolExecutor(4) as pool:
        alone = np.stack(list(pool.map(one, range(40))))
    assert (together == alone).all()
    again = camera.disc_frames(x, y, radius, states)  # states are left as they were
    assert (again == together).all()


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


def test_every_parameter_sets_its_field():
    nominal = TACTIPS[331].optics
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
        p.check(other)
        changed = flat(optics_from(nominal, {p.name: other}))
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
    assert (one.min(), one.max() <= 1) == (0, True)
