"""Presses that are drawn again: kept as they are, and only trusted where they give the errors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from changed_record import changed_record

from tactibench.board.html.drawn import Drawer, Drawn, pack_scenes, unpack_scenes
from tactibench.board.html.material import gather
from tactibench.board.html.opened import Opened
from tactibench.plugins.host import PluginHost

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def board():
    (found,) = gather(
        Path("none"), ROOT / "leaderboards", origin="board", protocols=("exp2",)
    ).boards
    return found


@pytest.fixture(scope="module")
def drawer(board, tmp_path_factory):
    return Drawer(board.protocol, PluginHost(), tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="module")
def record(board):
    return next(
        r for r in board.records if r["model"]["name"] == "cnn" and "tested" not in r["sensor"]
    )


def test_the_committed_errors_come_out_again(board, drawer, record, tmp_path):
    found = Opened(board, drawer, tmp_path).of(record)
    assert found is not None
    assert len(found.trials) == record.data.test
    assert drawer.drawn(record) is drawer.drawn(record)


def test_a_truth_that_gives_other_errors_is_not_used(board, drawer, record, tmp_path):
    errors = dict(board.errors)
    stated = errors[record.name]
    errors[record.name] = replace(stated, error=stated.error + 1e-3)
    assert Opened(replace(board, errors=errors), drawer, tmp_path).of(record) is None


def test_scenes_come_back_from_the_cache_as_they_were(drawer, record):
    drawn = drawer.drawn(record)
    assert isinstance(drawn, Drawn)
    again = Drawer(drawer._protocol, PluginHost(), drawer._cache).drawn(record)
    assert again.scenes == drawn.scenes
    for name, array in drawn.truth.items():
        np.testing.assert_array_equal(again.truth[name], array)


def test_packing_is_lossless_and_others_are_refused(drawer, record):
    from tactibench.board.html.drawn import Presses

    drawn = drawer.drawn(record)
    names = tuple(str(k) for k in range(len(drawn.scenes)))
    whole = Presses(drawn.scenes, names, names, 20.0)
    assert unpack_scenes(pack_scenes(whole)) == whole
    with pytest.raises(ValueError, match="equally many"):
        unpack_scenes({**pack_scenes(whole), "press": np.array(["x"])})


def test_frames_are_pressed_anew_and_alike(drawer, record):
    drawn = drawer.drawn(record)
    first, again = drawn.frames([3, 5]), drawn.frames([3, 5])
    assert sorted(first) == [3, 5]
    np.testing.assert_array_equal(first[3], again[3])
    assert first[3].dtype == np.uint8
    assert (first[3] != first[5]).any()


def test_what_cannot_be_drawn_says_why(drawer, record):
    other = changed_record(record, {"sensor.name": "nobody", "sensor.parameters": {}})
    assert "not installed" in drawer.drawn(other)
    on = {"name": "x", "parameters": {}, "asked": [], "on": "x", "presses": 1}
    tested = changed_record(record, {"sensor.tested": on})
    assert "others than the protocol draws" in drawer.drawn(tested)
