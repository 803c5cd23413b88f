from __future__ import annotations

import numpy as np
import pytest

from tactibench import UserError
from tactibench.markers import detect


def nearest(found, true):
    apart = np.linalg.norm(found[:, None] - true, axis=-1)
    assert len(set(apart.argmin(axis=1))) == len(true) == len(found)
    return apart.min(axis=1)


@pytest.mark.parametrize(("soft", "tolerance"), [(True, 0.02), (False, 0.25)])
def test_centroids_are_where_discs_were_drawn(drawn, rings, soft, tolerance) -> None:
    true = rings + np.random.default_rng(1).uniform(-0.5, 0.5, rings.shape)
    image = drawn(true, 3.7, 360, soft=soft)
    if not soft:
        image = np.where(image > 100, 255, 0).astype(np.uint8)
    found = detect(image)
    assert nearest(found.xy, true).max() < tolerance
    assert np.median(found.area) == pytest.approx(np.pi * 3.7**2, rel=0.06)


def test_the_rim_and_specks_are_no_markers(drawn, rings) -> None:
    image = drawn(rings, 3.7, 360, soft=False)
    row, column = np.indices(image.shape)
    away = np.hypot(row - 179.5, column - 179.5)
    image[(away > 165) & (away < 169)] = 208
    image[5, 5] = image[350, 7] = image[350, 352] = 208
    found = detect(image)
    assert len(found) == 331
    assert nearest(found.xy, rings).max() < 0.25


def test_markers_that_touch_are_parted(drawn) -> None:
    alone = [[20.0 + 20 * i, 20.0 + 20 * j] for i in range(8) for j in range(8)]
    pair = [[60.0, 185.0], [68.5, 188.0]]
    true = np.array(alone + pair)
    found = detect(drawn(true, 5.0, 200, soft=True))
    assert nearest(found.xy, true).max() < 0.7


@pytest.mark.parametrize("grey", [0, 37, 255])
def test_an_even_frame_holds_no_marker(grey) -> None:
    assert len(detect(np.full((64, 64), grey, dtype=np.uint8))) == 0


@pytest.mark.parametrize(
    "image", [np.zeros((8, 8, 3), dtype=np.uint8), np.zeros((8, 8)), np.zeros(8, dtype=np.uint8)]
)
def test_what_is_no_gray_frame_is_refused(image) -> None:
    with pytest.raises(UserError, match="gray frame"):
        detect(image)
