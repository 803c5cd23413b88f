"""Every fault against its closed form; none changes its input, all are repeated by their seed."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from tactibench.frames import FAULTS, faults, label_pins
from tactibench.protocols import Fault

Image = npt.NDArray[np.uint8]
NOTHING = {name: 1.0 if name == "gain" else 0.0 for name in FAULTS}
SOME = {
    "blur": 1.0,
    "noise": 8.0,
    "gain": 0.5,
    "glare": 8.0,
    "gain-drift": 0.4,
    "dead-rows": 4.0,
    "occlusion": 16.0,
    "lost-pins": 0.2,
    "spurious-blobs": 5.0,
    "shift": 1.3,
    "rotation": 2.0,
}
INSIDE = slice(10, 90)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def count(image: Image) -> int:
    return label_pins(image)[1]


def test_the_protocols_words_are_the_faults() -> None:
    assert set(FAULTS) == set(typing.get_args(Fault)) == set(SOME)


@pytest.mark.parametrize("name", FAULTS)
def test_the_amount_that_is_none_leaves_the_frame(name: str, image: Image) -> None:
    assert np.array_equal(FAULTS[name](image, NOTHING[name], rng()), image)


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_keeps_shape_and_type_and_its_input(
    name: str, image: Image, coloured: Image
) -> None:
    before = image.copy()
    out = FAULTS[name](image, SOME[name], rng())
    assert (out.shape, out.dtype) == (image.shape, np.uint8)
    assert np.array_equal(image, before)
    assert not np.array_equal(out, image)
    rgb = FAULTS[name](coloured, SOME[name], rng())
    assert (rgb.shape, rgb.dtype) == (coloured.shape, np.uint8)
    if name not in {"noise", "lost-pins"}:  # these draw for every pixel of every colour
        assert np.array_equal(rgb[..., 0], out)


@given(st.sampled_from(sorted(FAULTS)), st.integers(0, 2**32), st.floats(0.05, 0.9))
def test_a_fault_is_repeated_by_its_seed(name: str, seed: int, share: float) -> None:
    amount = share * 2 * SOME[name]
    grains = np.kron(rng(1).integers(0, 2, (12, 12)), np.full((4, 4), 200)).astype(np.uint8)
    first, second = (FAULTS[name](grains, amount, rng(seed)) for _ in range(2))
    assert np.array_equal(first, second)


def test_dead_rows_are_rows_of_one_constant(image: Image) -> None:
    out = faults.blacken_rows(image, 7, rng())
    dead = (out == 0).all(axis=1)
    assert dead.sum() == 7
    assert np.array_equal(out[~dead], image[~dead])
    more = (faults.blacken_rows(image, 20, rng()) == 0).all(axis=1)
    assert (more >= dead).all()


@pytest.mark.parametrize(("right", "down"), [(2, 0), (0, 2), (-3, 1)])
def test_a_shift_by_whole_pixels_is_a_roll_inside(image: Image, right: int, down: int) -> None:
    out = faults.move(image, float(right), float(down))
    rolled = np.roll(image, (down, right), axis=(0, 1))
    assert np.array_equal(out[INSIDE, INSIDE], rolled[INSIDE, INSIDE])


def test_a_shift_moves_every_pin_by_its_length(image: Image) -> None:
    def centres(of: Image) -> npt.NDArray[np.float64]:
        labels, found = label_pins(image)  # windows of the pins that were not moved
        wide = ndimage.grey_dilation(labels, size=3)
        return np.array(ndimage.center_of_mass(of - 15.0, wide, range(1, found + 1)))

    moved = centres(faults.move(image, 0.4, -0.3)) - centres(image)
    assert moved.mean(axis=0) == pytest.approx([-0.3, 0.4], abs=0.05)


def test_a_quarter_turn_is_exact_and_goes_from_x_to_y(image: Image) -> None:
    image[20:23, 60:70] = 255  # no symmetry
    assert np.array_equal(faults.rotate(image, 90), np.rot90(image, -1))
    mark = np.zeros((101, 101), np.uint8)
    mark[48:53, 80:85] = 200  # on the x axis, right of the middle
    row, column = np.unravel_index(faults.rotate(mark, 30).argmax(), mark.shape)
    assert np.degrees(np.arctan2(row - 50, column - 50)) == pytest.approx(30, abs=5)


@pytest.mark.parametrize("share", [0.01, 0.1, 0.3, 1.0])
def test_so_many_pins_are_lost_and_the_others_stay(image: Image, share: float) -> None:
    out = faults.remove_pins(image, share, rng())
    assert count(image) == 81
    assert count(out) == 81 - round(share * 81)
    labels, _ = label_pins(out)
    kept = labels > 0
    assert np.array_equal(out[kept], image[kept])
    lost = (label_pins(image)[0] > 0) & (out != image)
    assert out[lost].max(initial=0) < 25  # the ground's own levels


def test_lost_pins_are_nested(image: Image) -> None:
    few, many = (label_pins(faults.remove_pins(image, s, rng(3)))[0] > 0 for s in (0.1, 0.3))
    assert not (many & ~few).any()


def test_a_frame_without_pins_loses_none() -> None:
    flat = np.full((40, 40), 15, np.uint8)
    assert np.array_equal(faults.remove_pins(flat, 0.5, rng()), flat)
    assert faults.add_blobs(flat, 2, rng()).max() == 255


def test_blobs_are_as_large_and_as_bright_as_pins() -> None:
    ground = np.full((100, 100), 15, np.uint8)
    ground[50:53, 50:53] = 180
    out = faults.add_blobs(ground, 3, rng(2))
    labels, found = label_pins(out)
    assert found == 4
    area = np.bincount(labels.ravel())[1:]
    assert area.min() >= 5
    assert area.max() <= 14
    assert out.max() == 180


@pytest.mark.parametrize("factor", [0.25, 2.0])
def test_gain_multiplies_and_cuts_off(image: Image, factor: float) -> None:
    expected = np.minimum(np.rint(image.astype(float) * factor), 255)
    assert np.array_equal(faults.scale(image, factor), expected)


def test_noise_has_the_deviation_that_was_asked_for() -> None:
    grey = np.full((200, 200), 128, np.uint8)
    out = faults.add_noise(grey, 10.0, rng()).astype(float)
    assert out.std() == pytest.approx(10.0, rel=0.02)
    assert out.mean() == pytest.approx(128, abs=0.2)


def test_blur_spreads_a_point_as_a_gaussian_and_keeps_light() -> None:
    point = np.zeros((41, 41), np.uint8)
    point[20, 20] = 255
    out = faults.blur(point, 0.8).astype(float)
    y, x = np.mgrid[-20:21, -20:21]
    exact = 255 * np.exp(-(x**2 + y**2) / (2 * 0.8**2)) / (2 * np.pi * 0.8**2)
    assert np.abs(out - exact).max() < 8  # a kernel of samples, rounded
    assert out.sum() == pytest.approx(255, rel=0.02)


def test_drift_is_one_in_the_middle_and_linear() -> None:
    grey = np.full((101, 101), 100, np.uint8)
    out = faults.drift_gain(grey, 0.5, rng(7)).astype(float)
    assert out[50, 50] == 100
    assert {out.min(), out.max()} == {50.0, 150.0}
    assert np.abs(np.diff(out, 2, axis=0)).max() <= 1  # straight, but for rounding
    assert (out + out[::-1, ::-1]).max() == 200


def test_glare_is_white_in_its_middle_and_ends_at_its_radius() -> None:
    dark = np.zeros((128, 128), np.uint8)
    out = faults.add_glare(dark, 16.0, rng())
    assert (out == 255).sum() == pytest.approx(np.pi * 8**2, rel=0.1)
    assert (out > 0).sum() == pytest.approx(np.pi * 16**2, rel=0.1)


def test_occlusion_is_a_black_square() -> None:
    white = np.full((128, 128), 255, np.uint8)
    out = faults.occlude(white, 24.0, rng())
    rows, columns = np.nonzero(out == 0)
    assert (np.ptp(rows) + 1, np.ptp(columns) + 1) == (24, 24)
    assert len(rows) == 24**2
