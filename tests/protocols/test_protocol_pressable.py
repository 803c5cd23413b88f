"""Presses of a protocol, drawn for a sensor that is not its dome."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from tactibench import UserError, Workspace
from tactibench.geometry import true_contacts
from tactibench.protocols import draw_scenes, load_protocol, pressable

KEYS = load_protocol("exp3").spec


@dataclass(frozen=True)
class Shaped:
    dome_radius_mm: float | None = None
    deepest_mm: float = math.inf
    workspace: Workspace | None = None


def test_a_sensor_that_says_nothing_changes_nothing() -> None:
    assert pressable(KEYS, Shaped()) == KEYS


@pytest.mark.long
def test_presses_of_a_flat_pad_are_as_deep_as_it_can_be_pressed() -> None:
    flat = pressable(KEYS, Shaped(math.inf, 3.0))
    scenes = draw_scenes(flat, "triples").scenes
    assert len(scenes) == KEYS.draw("triples").count
    depths = []
    for scene in scenes:
        truth = true_contacts(scene, math.inf)
        assert len(truth) == 3
        assert np.abs(truth.xy).max() <= 6.4 + 1e-9
        depths.append(truth.depth)
    every = np.concatenate(depths)
    assert every.min() >= 0.5 - 1e-8
    assert every.min() < 0.55
    assert 2.9 < every.max() <= 3.0 + 1e-8


def test_singles_stay_where_they_are_on_the_dome() -> None:
    flat = draw_scenes(pressable(KEYS, Shaped(math.inf, 3.0)), "singles").scenes
    dome = draw_scenes(KEYS, "singles").scenes
    assert [(s.pose.x, s.pose.y) for s in flat] == [(s.pose.x, s.pose.y) for s in dome]


def test_a_pad_too_thin_for_the_protocol_is_refused() -> None:
    assert pressable(KEYS, Shaped(math.inf, 50.0)).workspace.depth_max_mm == 6.0
    with pytest.raises(UserError, match=r"0\.4 mm deep, but protocol 'exp3' presses 0\.5 mm"):
        pressable(KEYS, Shaped(math.inf, 0.4))
