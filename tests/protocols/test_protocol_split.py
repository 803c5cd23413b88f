"""Splits: every press in one part, the published test frames exactly."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import SensorContext, UserError
from tactibench.frames import published_frames
from tactibench.protocols import (
    PressSplit,
    Recorded,
    Split,
    load_protocol,
    split_presses,
    split_recorded,
)

SHARED = Path(__file__).parents[3] / "shared/data/tac-vgnn"
REAL = Path(os.environ.get("TACTIBENCH_TACVGNN", SHARED))
SHARES = Recorded(test_share=0.2, validation_share=0.1)


def assert_partition(parts: PressSplit, count: int) -> None:
    every = [*parts.fit, *parts.validation, *parts.test]
    assert sorted(every) == list(range(count))
    for part in (parts.fit, parts.validation, parts.test):
        assert list(part) == sorted(part)
        assert all(type(i) is int for i in part)


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 40), st.integers(1, 40), st.integers(1, 40), st.integers(0, 2**63))
def test_drawn_presses_are_divided_completely(
    fit: int, validation: int, test: int, seed: int
) -> None:
    split = Split(draw="singles", test=test, validation=validation)
    parts = split_presses(fit + validation + test, split, seed)
    assert_partition(parts, fit + validation + test)
    assert (len(parts.fit), len(parts.validation), len(parts.test)) == (fit, validation, test)
    assert split_presses(fit + validation + test, split, seed) == parts


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 200), st.integers(0, 2**63))
def test_recorded_presses_are_divided_completely_or_refused(count: int, seed: int) -> None:
    names = [f"frame_{i}" for i in range(count)]
    test = round(0.2 * count)
    validation = round(0.1 * (count - test))
    if min(test, validation, count - test - validation) < 1:
        with pytest.raises(UserError, match="record more presses"):
            split_recorded(names, SHARES, seed, None)
        return
    parts = split_recorded(names, SHARES, seed, None)
    assert_partition(parts, count)
    assert (len(parts.test), len(parts.validation)) == (test, validation)


@given(st.data())
def test_published_test_frames_are_taken_as_they_are(data: st.DataObject) -> None:
    names = [f"frame_{i}" for i in range(40)]
    published = data.draw(st.lists(st.sampled_from(names), min_size=1, max_size=20, unique=True))
    parts = split_recorded(names, SHARES, 7, published)
    assert_partition(parts, 40)
    assert {names[i] for i in parts.test} == set(published)


def test_a_folder_of_hardly_more_than_the_published_frames_is_refused() -> None:
    names = [f"frame_{i}" for i in range(12)]
    with pytest.raises(UserError, match="would train"):
        split_recorded(names, SHARES, 0, names[:11])


def test_the_published_split_needs_every_name_and_the_size() -> None:
    surface = load_protocol("surface")
    listed = list(surface.test_frames)
    names = [*listed, "another.png"]
    assert published_frames(surface, names, [360, 360]) == surface.test_frames
    assert published_frames(surface, names, [180, 360]) is None
    assert published_frames(surface, names, None) is None
    assert published_frames(surface, names[1:], [360, 360]) is None
    assert published_frames(surface, listed, [360, 360]) is None  # nothing to train on
    assert published_frames(load_protocol("exp1"), names, [360, 360]) is None


@pytest.mark.skipif(not REAL.is_dir(), reason="the Tac-VGNN recordings are not here")
@pytest.mark.long
def test_the_published_split_of_the_real_folder() -> None:
    from tactibench_recorded.sensor import RecordedSensor

    surface = load_protocol("surface")
    sensor = RecordedSensor(SensorContext(np.random.SeedSequence(0), REAL / "331"))
    names = list(sensor.scenes())
    published = published_frames(surface, names, sensor.describe()["image"])
    spec = surface.spec
    assert spec.recorded is not None
    parts = split_recorded(names, spec.recorded, spec.data_seed, published)
    assert_partition(parts, len(names))
    assert len(parts.test) == 1210
    assert {names[i] for i in parts.test} == set(surface.test_frames)
