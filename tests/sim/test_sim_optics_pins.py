"""Where the pins stand, and the real rest frames."""

import numpy as np
import pytest
from scipy import ndimage
from scipy.optimize import least_squares, linear_sum_assignment
from tac_vgnn import tac_vgnn_folder

from tactibench import SensorContext
from tactibench_sim import (
    HEXAGON,
    RINGS,
    Optics,
    TacTip127,
    TacTip331,
    layout,
    polar_angles,
    project,
)


def test_pins_at_rest_are_seen_where_the_real_ones_are():
    """The derivation of the polar angles: projected back they give the radii of the real frames."""
    x, y, _ = project(Optics(size=1), 17 * layout(331), 35.0)
    rings = np.unique(np.hypot(x, y).round(9))
    assert rings == pytest.approx(np.array(RINGS), abs=1e-9)
    x, y, _ = project(Optics(size=1), 17 * layout(127), 35.0)
    pitch = np.array([0, 1, np.sqrt(3), 2])
    told = HEXAGON[0] * pitch + HEXAGON[1] * pitch**3 + HEXAGON[2] * pitch**5
    assert np.unique(np.hypot(x, y).round(9))[:4] == pytest.approx(told, abs=1e-9)


def test_the_outermost_pins_stand_65_deg_from_the_apex():
    polar = np.degrees(np.arccos(layout(331)[:, 2]))
    assert polar.max() == pytest.approx(65.0, abs=0.1)
    assert np.degrees(polar_angles(np.array([0.0, 1e-6]))) == pytest.approx([0, 0], abs=1e-3)


@pytest.mark.parametrize("pins", [127, 331])
def test_layout_is_a_centred_unit_pattern_that_fits_the_frame(pins):
    b = layout(pins)
    assert b.shape == (pins, 3)
    assert np.linalg.norm(b, axis=1) == pytest.approx(np.ones(pins), abs=1e-14)
    assert tuple(b[0]) == (0, 0, 1)
    assert abs(b[:, :2].mean(axis=0)).max() < 1e-12
    x, y, radius = project(Optics(), 17 * b, 35.0)
    assert (np.stack([x, y]) - radius > 0).all()
    assert (np.stack([x, y]) + radius < 127).all()
    turned = b[:, [0]] * np.array([[0.5, 0.75**0.5]]) + b[:, [1]] * np.array([[-(0.75**0.5), 0.5]])
    gap = np.linalg.norm(turned[:, None] - b[None, :, :2], axis=2).min(axis=1)
    assert gap.max() < 1e-12  # sixfold


def rest_frame(pins):
    path = tac_vgnn_folder(f"{pins}/model_surface2d") / "frames_bw" / "init_0.png"
    import cv2

    return cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)


@pytest.mark.parametrize(("pins", "size"), [(127, 256), (331, 360)])
def test_layout_against_the_real_rest_frame(pins, size):
    blobs, _ = ndimage.label(rest_frame(pins) > 127)
    numbers = np.arange(1, blobs.max() + 1)
    area = ndimage.sum_labels(blobs > 0, blobs, numbers)
    numbers = numbers[(area > 5) & (area < 130)]  # the rest is the rim's glare and specks
    seen = np.array(ndimage.center_of_mass(blobs > 0, blobs, numbers))[:, ::-1]
    assert len(seen) == pins
    x, y, _ = project(Optics(size=size), 17 * layout(pins), 35.0)
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


@pytest.mark.parametrize(("kind", "pins", "size"), [(TacTip127, 127, 356), (TacTip331, 331, 360)])
def test_thresholded_discs_have_the_real_area(kind, pins, size):
    """size: of the real frames when they were thresholded (the 127 set was resized later)."""
    real = rest_frame(pins)
    ours = kind(SensorContext(np.random.SeedSequence(0)), size=size, noise=False, output="bw")
    share = []
    for image in (real, ours.rest().image):
        blobs, count = ndimage.label(image > 127)
        area = ndimage.sum_labels(blobs > 0, blobs, np.arange(1, count + 1))
        share.append(np.median(area[(area > 5) & (area < 160)]) / image.size)
    assert share[1] == pytest.approx(share[0], rel=0.06)
