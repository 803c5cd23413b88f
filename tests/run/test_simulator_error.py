"""The simulator's own error in the record of a run, by test set."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tactibench.frames import FrameSet, GeneratedFrameSet
from tactibench.records import StoredRun, open_run, parse_record
from tactibench.run import TestOptions

Run = Callable[..., StoredRun]


def bounds_by_depth(self: Any, scenes: Any) -> np.ndarray:
    """0.01 mm per mm of depth; nothing is known of presses below 5 mm."""
    depth = np.array([scene.pose.depth for scene in scenes])
    return np.where(depth > 5, np.inf, 0.01 * depth)


def terms_by_tips(self: Any, scenes: Any) -> dict[str, int]:
    return {"pair": sum(len(scene.indenter.offsets) == 2 for scene in scenes)}


@pytest.fixture
def knows_its_error(tiny: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiny.TinySensor, "error_bounds", bounds_by_depth)
    monkeypatch.setattr(tiny.TinySensor, "terms", terms_by_tips)


@pytest.mark.usefixtures("knows_its_error")
def test_the_record_has_the_error_of_every_test_set(run: Run, planned: Any, tmp_path: Any) -> None:
    done = run("exp2")
    sets = planned("exp2").frames.test
    assert [error.name for error in done.record.data.simulator] == [
        *("pairs", "catch"),
        *("between", "uneven"),
    ]
    for error, frames in zip(done.record.data.simulator, sets, strict=True):
        depth = np.array([scene.pose.depth for scene in frames.scenes])
        known = 0.01 * depth[depth <= 5]
        assert (error.scenes, error.unknown) == (len(depth), (depth > 5).sum())
        assert error.median_mm == pytest.approx(np.median(known), abs=1e-4)
        assert error.p95_mm == pytest.approx(np.quantile(known, 0.95), abs=1e-4)
        assert error.max_mm == pytest.approx(known.max(), abs=1e-4)
        assert error.terms == {"pair": 0 if error.name == "catch" else len(depth)}
    again = open_run(tmp_path / "runs", done.record.name)
    assert again.record.data.simulator == done.record.data.simulator


def test_a_simulated_sensor_that_says_nothing_is_recorded_as_not_known(run: Run) -> None:
    (error,) = run("exp1").record.data.simulator
    assert (error.name, error.scenes, error.unknown) == ("singles", 20, 20)
    assert (error.median_mm, error.p95_mm, error.max_mm, error.terms) == (None, None, None, {})


def test_frames_that_finite_elements_made_have_no_such_error(run: Run) -> None:
    assert run("exp1", test=TestOptions(reference=True)).record.data.simulator == []


def test_recorded_frames_have_no_sensor_to_ask() -> None:
    assert FrameSet.open_sensor(None) is None  # type: ignore[arg-type]
    assert GeneratedFrameSet.open_sensor is not FrameSet.open_sensor


def test_a_record_without_it_is_read_and_written_as_it_was(run: Run) -> None:
    values = run("exp1").record.json_values()
    del values["data"]["simulator"]
    old = parse_record(values, "an older record")
    assert old.data.simulator == []
    assert old.json_values() == values
