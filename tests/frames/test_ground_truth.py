"""Surfaces and bounds beside the frames: computed once, computed again when damaged."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stubs import StubSensor

from tactibench import Grid, SensorContext
from tactibench.frames import FrameRecipe, open_frames, true_bounds, true_surfaces

GRID = Grid.centred(8, 0.4)
RequestOf = Callable[..., FrameRecipe]


@pytest.fixture
def sensor(request_of: RequestOf) -> Any:
    return request_of().build(SensorContext(np.random.SeedSequence(0)))


def test_surfaces_are_kept(
    request_of: RequestOf, sensor: Any, counter: Any, tmp_path: Path
) -> None:
    presses = open_frames(request_of(), tmp_path)
    first = true_surfaces(sensor, presses, GRID)
    assert first is not None
    assert first.shape == (25, 8, 8)
    np.testing.assert_allclose(first[:, 0, 0], [s.pose.depth for s in presses.scenes], rtol=1e-3)
    again = true_surfaces(sensor, open_frames(request_of(), tmp_path), GRID)
    np.testing.assert_array_equal(first, again)
    assert counter.surfaces == 25
    for other in (Grid.centred(8, 0.5), Grid.centred(9, 0.4), Grid((8, 8), (0.0, 0.0), 0.4)):
        true_surfaces(sensor, presses, other)
    assert counter.surfaces == 100


def test_bounds_of_all_contacts_stand_in_one_array(
    request_of: RequestOf, sensor: Any, tmp_path: Path
) -> None:
    presses = open_frames(request_of(), tmp_path)
    for bounds in (true_bounds(sensor, presses), true_bounds(sensor, presses)):
        assert bounds is not None
        assert bounds.shape == (12 * (1 + 2) + 1, 3), "one and two contacts in turn"
        assert bounds[6, 0] == pytest.approx(1.04), "the first contact of the fifth press"


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 no zip", "flip", "cut"])
def test_a_damaged_file_is_computed_again(
    request_of: RequestOf, sensor: Any, counter: Any, tmp_path: Path, damage: bytes | str
) -> None:
    presses = open_frames(request_of(), tmp_path)
    first = true_surfaces(sensor, presses, GRID)
    (path,) = tmp_path.rglob("surface-*.npz")
    raw = bytearray(path.read_bytes())
    raw[len(raw) // 3] ^= 0x10
    path.write_bytes({"flip": bytes(raw), "cut": bytes(raw)[:40]}.get(str(damage), damage))  # type: ignore[arg-type]
    np.testing.assert_array_equal(true_surfaces(sensor, presses, GRID), first)
    assert counter.surfaces == 50
    true_surfaces(sensor, presses, GRID)
    assert counter.surfaces == 50


def test_nobody_knows(request_of: RequestOf, tmp_path: Path) -> None:
    presses = open_frames(request_of(), tmp_path)
    assert true_surfaces(StubSensor(), presses, GRID) is None
    assert true_bounds(StubSensor(), presses) is None
