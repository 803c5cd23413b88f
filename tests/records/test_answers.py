"""Packed answers: what is rounded, and by how much."""

from __future__ import annotations

import numpy as np
import pytest

from tactibench import Contacts, PlatePose
from tactibench.records import pack, round_answers, unpack


def test_places_move_by_half_a_micrometre_and_scores_by_a_thousandth() -> None:
    rng = np.random.default_rng(0)
    xy, depth = rng.uniform(-9, 9, (500, 2)), rng.uniform(0, 6, 500)
    std = 10.0 ** rng.uniform(-6, 1, (500, 3))
    packed = pack([Contacts(xy, depth, rng.uniform(1e-9, 1, 500), std)], "contacts")
    rounded = round_answers(packed)
    for name in ("xy", "depth"):
        assert np.abs(rounded[name] - packed[name]).max() <= 2.0**-11
        assert (rounded[name] * 1024 == np.rint(rounded[name] * 1024)).all()
    for name in ("score", "std"):
        assert np.abs(rounded[name] / packed[name] - 1).max() <= 2.0**-10
    assert rounded["count"] is packed["count"]


@pytest.mark.parametrize("value", [0.0, 1.0, -0.0, 2.0**41 + 1, 1e300, -1e300, np.nan])
def test_round_and_very_large_numbers_stay(value: float) -> None:
    (again,) = round_answers({"depth": np.array([value])})["depth"]
    assert again == value or (np.isnan(again) and np.isnan(value))
    (again,) = round_answers({"std": np.array([value])})["std"]
    assert again == pytest.approx(value, rel=1e-3, nan_ok=True)


def test_rounded_answers_are_packed_as_they_are_and_rounded_no_more() -> None:
    poses = [PlatePose(0.123456, -7.654321, (0.0123, 1.23)), None, PlatePose(3.0, 0.0)]
    rounded = round_answers(pack(poses, "plate"))
    again = round_answers(pack(unpack(rounded, "plate"), "plate"))
    assert all(np.array_equal(rounded[name], again[name], equal_nan=True) for name in rounded)
