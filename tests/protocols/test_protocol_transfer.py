"""Protocols that change the sensor: their tables, training plates and labelled frames."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tactibench import UserError
from tactibench.protocols import (
    LoadedProtocol,
    draw_plates,
    draw_shots,
    load_protocol,
    protocol_files,
)

Read = Callable[[dict[str, Any]], LoadedProtocol]


def tables() -> dict[str, Any]:
    return tomllib.loads(protocol_files()["transfer"].read_text(encoding="utf-8"))


def test_plates_fill_the_ranges_and_are_the_same_again() -> None:
    spec = load_protocol("transfer").spec
    assert spec.plates is not None
    scenes = draw_plates(spec, spec.plates).scenes
    assert len(scenes) == spec.plates.count
    assert scenes == draw_plates(spec, spec.plates).scenes
    assert all(scene.indenter.is_plate and scene.pose.yaw == 90 for scene in scenes)
    depth = np.array([scene.pose.depth for scene in scenes])
    tilt = np.array([scene.pose.tilt for scene in scenes])
    space = spec.workspace
    for values, low, high in (
        (depth, space.depth_min_mm, space.depth_max_mm),
        (tilt, -spec.plates.tilt_deg, spec.plates.tilt_deg),
    ):
        assert low <= values.min() < low + 0.02 * (high - low)
        assert high - 0.02 * (high - low) < values.max() <= high
        assert values.mean() == pytest.approx((low + high) / 2, abs=0.03 * (high - low))


def test_fewer_shots_are_the_first_of_more() -> None:
    spec = load_protocol("transfer").spec
    drawn = draw_shots(spec, 1000)
    assert len(set(drawn)) == len(drawn) == 200
    assert drawn == draw_shots(spec, 1000)
    assert max(drawn) < 1000
    assert draw_shots(spec, 30) == draw_shots(spec, 30)
    assert len(draw_shots(spec, 30)) == 30
    assert draw_shots(load_protocol("surface").spec, 1000) == ()


@pytest.mark.parametrize(
    ("where", "value", "said"),
    [
        (("transfer", "shots"), [0, 50, 10], "begin with 0"),
        (("transfer", "shots"), [0, 10, 10], "begin with 0"),
        (("transfer", "stream"), 1, "same stream"),
        (("answer",), "contacts", "plate"),
    ],
)
def test_contradictions_are_said(
    read_tables: Read, where: tuple[str, ...], value: Any, said: str
) -> None:
    changed = tables()
    inside = changed
    for key in where[:-1]:
        inside = inside[key]
    inside[where[-1]] = value
    with pytest.raises(UserError, match=said):
        read_tables(changed)
