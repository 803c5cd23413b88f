from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactibench import UserError
from tactibench.markers import Markers, detect, match

SEEDS = st.integers(0, 2**32 - 1)


def markers(xy):
    return Markers(xy, np.full(len(xy), 40.0))


def hexagon(rings=7, pitch=11.0):
    cells = [(q, r) for q in range(-rings, rings + 1) for r in range(-rings, rings + 1)]
    q, r = np.array([c for c in cells if abs(sum(c)) <= rings], dtype=float).T
    return pitch * np.stack([q + r / 2, np.sqrt(3) / 2 * r], axis=1) + 130.0


def dimple(rest, centre, height, width):
    """Markers spread from a contact by up to ``height`` px."""
    away = rest - centre
    reach = np.hypot(*away.T)[:, None] / width
    return height * away / width * np.exp((1 - reach**2) / 2)


@given(SEEDS, st.floats(0, 10), st.floats(45, 70))
def test_a_spreading_field_is_found_with_gaps_and_extra_blobs(seed, height, width) -> None:
    rng = np.random.default_rng(seed)
    rest = hexagon()
    moved = rest + dimple(rest, 130 + rng.uniform(-25, 25, 2), height, width)
    seen = rng.permutation(len(rest))[: len(rest) - 3]
    extra = rng.uniform(5, 255, (3, 2))
    extra = extra[np.linalg.norm(extra[:, None] - moved, axis=-1).min(axis=1) > 5.0]
    blobs = np.concatenate([moved[seen], extra])[rng.permutation(len(seen) + len(extra))]
    found = match(markers(blobs), rest)
    right = np.isclose(found, moved).all(axis=1)
    known = np.isfinite(found[:, 0])
    assert right[seen].mean() > 0.97
    assert (~right & known).sum() <= 3  # a stray blob may stand where a lost marker would be


def test_all_are_found_exactly_whatever_their_order() -> None:
    rng = np.random.default_rng(2)
    rest = hexagon()
    moved = rest + dimple(rest, [120.0, 140.0], 10.0, 50.0)
    found = match(markers(moved[rng.permutation(len(rest))]), rest)
    assert np.array_equal(found, moved)
    assert np.linalg.norm(moved - rest, axis=1).max() > 0.85 * 11.0


def test_a_lost_marker_is_nan_and_the_others_stay() -> None:
    rest = hexagon()
    found = match(markers(np.delete(rest, 80, axis=0)), rest)
    assert np.isnan(found[80]).all()
    assert np.array_equal(np.delete(found, 80, axis=0), np.delete(rest, 80, axis=0))


def test_no_blob_no_marker() -> None:
    assert np.isnan(match(markers(np.empty((0, 2))), hexagon())).all()


@pytest.mark.parametrize("rest", [np.zeros((2, 2)), np.zeros((5, 3)), np.full((4, 2), np.nan)])
def test_what_is_no_layout_is_refused(rest) -> None:
    with pytest.raises(UserError, match="layout"):
        match(markers(np.zeros((3, 2))), rest)


def test_every_pin_of_little_sheared_real_presses_is_matched() -> None:
    import cv2
    import pandas as pd

    default = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "tac-vgnn"
    folder = Path(os.environ.get("TACTIBENCH_TACVGNN", default)) / "331" / "model_surface2d"
    if not folder.is_dir():
        pytest.skip(f"the Tac-VGNN frames are not at {folder}; set TACTIBENCH_TACVGNN")
    table = pd.read_csv(folder / "targets.csv")
    names = table.image_name[table.move_1.abs() < 1].iloc[::40]
    rest = detect(cv2.imread(str(folder / "frames_bw" / "init_0.png"), cv2.IMREAD_GRAYSCALE)).xy
    assert len(rest) == 331
    for name in names:
        frame = cv2.imread(str(folder / "frames_bw" / name), cv2.IMREAD_GRAYSCALE)
        assert np.isfinite(match(detect(frame), rest)).all(), name
