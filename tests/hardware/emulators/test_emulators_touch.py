"""Contact of a tool with the dome, against tactibench's geometry and against plain search."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import Indenter
from tactibench.geometry import DOME_RADIUS_MM, tip_depths, tip_positions
from tactibench_tactip.emulators.motion import Array, inverse, matrix
from tactibench_tactip.emulators.touch import Rig, Touch

SHIFTED = Rig(sensor_frame=(0.7, -0.4, 1.2, 180.0, 0.0, 12.0))
INDENTERS = (
    Indenter.single(),
    Indenter.dual(8.0),
    Indenter.triple((0.0, 1.5, 0.5)),
    Indenter.single(1.5),
)


def gap(touch: Touch, tool: Array) -> float:
    """Least distance of a tip's surface from the dome's, mm: by the centres' distance."""
    rig = touch.rig
    seen = inverse(matrix(rig.sensor_frame)) @ tool
    gaps = []
    for dx, dy, dz in rig.indenter.offsets:
        centre = (seen @ [dx, -dy, dz - rig.indenter.radius, 1.0])[:3]
        gaps.append(
            np.linalg.norm(centre - [0, 0, -DOME_RADIUS_MM]) - DOME_RADIUS_MM - rig.indenter.radius
        )
    return float(min(gaps))


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(INDENTERS),
    st.floats(-6, 6),
    st.floats(-6, 6),
    st.floats(-180, 180),
    st.floats(-20, 20),
    st.floats(-20, 20),
    st.floats(0.1, 6),
)
def test_depth_is_the_travel_past_first_touch(
    indenter: Indenter, x: float, y: float, yaw: float, alpha: float, beta: float, depth: float
) -> None:
    """Found by bisection along z from far away, whatever the tool's tilt."""
    touch = Touch(replace(SHIFTED, indenter=indenter), DOME_RADIUS_MM)
    low, high = -40.0, 10.0
    for _ in range(45):
        z = (low + high) / 2
        low, high = (z, high) if gap(touch, matrix((x, y, z, alpha, beta, yaw))) > 0 else (low, z)
    truth = touch.truth(matrix((x, y, low + depth, alpha, beta, yaw)))
    assert truth.depth_mm == pytest.approx(depth, abs=1e-6)
    assert truth.scene is not None
    assert truth.scene.pose.depth == truth.depth_mm
    assert truth.contacts.depth.max() == pytest.approx(depth, abs=1e-6)


@settings(max_examples=30, deadline=None)
@given(st.sampled_from(INDENTERS), st.floats(-5, 5), st.floats(-5, 5), st.floats(-180, 180))
def test_the_scene_has_the_tips_where_the_tool_has_them(
    indenter: Indenter, x: float, y: float, yaw: float
) -> None:
    """A tilt of nearly nothing goes another way through the code to the same scene."""
    touch = Touch(replace(SHIFTED, indenter=indenter), DOME_RADIUS_MM)
    upright = touch.truth(matrix((x, y, 5.0, 0.0, 0.0, yaw)))
    tilted = touch.truth(matrix((x, y, 5.0, 0.01, 0.0, yaw)))
    assert upright.scene is not None
    assert tilted.scene is not None
    assert upright.scene.indenter == indenter
    for scene in (upright.scene, tilted.scene):
        seen = tip_positions(scene)[:, :2]
        assert np.allclose(seen, tip_positions(upright.scene)[:, :2], atol=0.01)
        assert np.allclose(tip_depths(scene), tip_depths(upright.scene), atol=0.01)
    assert np.allclose(upright.contacts.xy, tilted.contacts.xy, atol=0.01)


def test_the_sensors_frame_is_where_the_rig_says() -> None:
    touch = Touch(Rig(sensor_frame=(0.7, -0.4, 1.2, 180.0, 0.0, 12.0)), DOME_RADIUS_MM)
    truth = touch.truth(matrix((0.7, -0.4, 1.2 + 2.0, 0.0, 0.0, 12.0)))
    assert truth.depth_mm == pytest.approx(2.0)
    assert np.allclose(truth.contacts.xy, 0.0, atol=1e-9)
    assert truth.scene is not None
    assert truth.scene.pose.yaw == pytest.approx(0.0, abs=1e-9)
    aside = touch.truth(matrix((0.7 + 3.0, -0.4, 4.0, 0.0, 0.0, 12.0)))
    angle = math.radians(12.0)
    assert np.allclose(aside.contacts.xy, [[3 * math.cos(angle), 3 * math.sin(angle)]])


@settings(max_examples=40, deadline=None)
@given(st.floats(0, 40), st.floats(-180, 180), st.floats(0.1, 5))
def test_a_plate_presses_along_its_normal(tilt: float, turn: float, depth: float) -> None:
    """With the plate's centre on the line through the dome's centre, depth below its crown."""
    touch = Touch(Rig(indenter=Indenter.plate()), DOME_RADIUS_MM)
    a, b = math.radians(tilt), math.radians(turn)
    normal = np.array([math.sin(a) * math.cos(b), math.sin(a) * math.sin(b), math.cos(a)])
    side = np.cross(normal, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    seen = np.eye(4)
    seen[:3, :3] = np.column_stack([side, np.cross(-normal, side), -normal])
    seen[:3, 3] = (DOME_RADIUS_MM - depth) * normal - [0, 0, DOME_RADIUS_MM]
    truth = touch.truth(matrix(touch.rig.sensor_frame) @ seen)
    assert truth.depth_mm == pytest.approx(depth)
    assert truth.scene is not None
    assert truth.scene.pose.tilt == pytest.approx(tilt, abs=1e-4)
    assert np.allclose(truth.contacts.xy, DOME_RADIUS_MM * normal[:2], atol=1e-4)


def test_a_flat_pad_is_touched_at_its_own_height() -> None:
    touch = Touch(Rig(indenter=Indenter.triple((0.0, 1.0, 2.0))), math.inf)
    truth = touch.truth(matrix((9.0, 0.0, 0.5, 0.0, 0.0, 0.0)))
    assert truth.depth_mm == pytest.approx(2.5)
    assert sorted(truth.contacts.depth) == pytest.approx([0.5, 1.5, 2.5])
    plate = Touch(Rig(indenter=Indenter.plate()), math.inf)
    assert plate.truth(matrix((0, 0, 1.0, 0, 0, 0))).depth_mm == pytest.approx(1.0)


def test_beside_the_dome_nothing_touches() -> None:
    touch = Touch(Rig(), DOME_RADIUS_MM)
    truth = touch.truth(matrix((30.0, 0.0, 5.0, 0.0, 0.0, 0.0)))
    assert truth.depth_mm == -math.inf
    assert truth.scene is None
    assert len(truth.contacts) == 0
    assert truth.force_n == 0.0
