"""The position form of a plate: the contact that a heatmap model draws and reads."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactibench import PlatePose
from tactibench.training import PlateScale


def test_a_plate_touches_at_20_mm_times_the_sine_of_its_tilt():
    contact = PlateScale().contacts(PlatePose(3.0, 30.0))
    assert contact.xy.tolist() == [[pytest.approx(10.0), 0.0]]
    assert contact.depth.tolist() == [3.0]


@given(st.floats(-4, 0), st.floats(-45, 45), st.floats(0, 6))
def test_the_contact_is_read_back_as_the_plate(depth, tilt, offset):
    scale = PlateScale(offset)
    found = scale.plate(scale.contacts(PlatePose(depth, tilt)))
    assert math.isclose(found.depth, depth, abs_tol=1e-12)
    assert math.isclose(found.tilt, tilt, abs_tol=1e-9)


def test_labels_below_zero_are_drawn_above_it():
    poses = [PlatePose(-4.0, 0.0), PlatePose(0.0, 5.0)]
    scale = PlateScale.of(poses, 6.0)
    assert [float(scale.contacts(pose).depth[0]) for pose in poses] == [0.5, 4.5]
