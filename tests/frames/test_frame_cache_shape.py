"""Data sets of sensors that are no dome of the protocol's radius."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactibench.frames import FrameRecipe, open_frames
from tactibench.geometry import true_contacts

RequestOf = Callable[..., FrameRecipe]


def test_another_shape_is_another_key(request_of: RequestOf) -> None:
    keys = {request_of(dome_radius=radius).key for radius in (None, math.inf, 15.0, 25.0)}
    assert len(keys) == 4


@pytest.mark.parametrize("radius", [math.inf, 12.0])
def test_truth_is_on_the_sensors_surface(
    request_of: RequestOf, tmp_path: Path, radius: float
) -> None:
    presses = open_frames(request_of(dome_radius=radius), tmp_path)
    assert presses.dome_radius == radius
    for answer, scene in zip(presses.truth("contacts", 20.0), presses.reached(), strict=True):
        found: Any = answer
        np.testing.assert_array_equal(found.depth, true_contacts(scene, radius).depth)


def test_truth_of_a_dual_differs_between_dome_and_pad(
    request_of: RequestOf, tmp_path: Path
) -> None:
    flat: Any = open_frames(request_of(dome_radius=math.inf), tmp_path).truth("contacts", 20.0)[3]
    dome: Any = open_frames(request_of(), tmp_path).truth("contacts", 20.0)[3]
    assert flat.depth[0] == flat.depth[1]
    assert dome.depth[0] != dome.depth[1]
