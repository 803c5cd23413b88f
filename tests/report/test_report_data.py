"""The data of a report: stored runs, committed records, both; of each the newest and whole ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from report_material import contact_parts, store_of
from stored_answers import store_run

from tactibench import UserError
from tactibench.board import add, ranked_errors
from tactibench.report import gather

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def store(tmp_path_factory, fabricate):
    folder = tmp_path_factory.mktemp("made") / "runs"
    store_of(folder, fabricate)
    return folder


def names(data):
    return {board.name: len(board.records) for board in data.boards}


def test_auto_takes_the_store_and_else_the_board(store, tmp_path):
    board = tmp_path / "leaderboards"
    board.mkdir()
    assert names(gather(store, board)) == {"exp1": 4, "exp2": 2}
    made = gather(tmp_path / "none", ROOT / "leaderboards")
    shown = {board.protocol.spec.id for board in made.boards}
    assert shown >= {"exp1", "exp2", "exp3", "surface"}
    assert "committed records" in made.origin


def test_both_takes_the_newest_of_a_row_and_seed(store, tmp_path, fabricate):
    board = tmp_path / "leaderboards"
    old = contact_parts(seed=7)
    was = fabricate(created="2020-01-01T00:00:00+00:00", name="exp1-unet-old", error=0.9)
    add(store_run(tmp_path / "old", was, old), board)
    add(store_run(tmp_path / "old", fabricate(model="vgnn", encoder=None), old), board)
    made = gather(store, board, origin="both")
    records = {r.name for b in made.boards if b.name == "exp1" for r in b.records}
    assert "exp1-unet-old" not in records
    assert len(records) == 5
    assert made.origin.startswith("Made from 1 committed record and 6 runs stored in ")
    assert names(gather(store, board, origin="board")) == {"exp1": 2}


def test_partial_runs_are_counted_and_left_out(tmp_path, fabricate):
    parts = contact_parts()
    for partial in (True, False):
        record = fabricate(partial=partial, name=f"exp1-unet-{partial}")
        store_run(tmp_path / "runs", record, parts)
    (tmp_path / "runs" / "damaged").mkdir()
    (tmp_path / "runs" / "damaged" / "record.json").write_text("{", encoding="utf-8")
    made = gather(tmp_path / "runs", tmp_path)
    assert names(made) == {"exp1": 1}
    assert "Left out: 1 partial run and 1 run that cannot be read." in made.origin


def test_ranks_rest_on_the_same_errors_as_a_board(store, tmp_path):
    (board, _) = gather(store, tmp_path).boards
    for name, run in board.runs.items():
        wanted = ranked_errors(board.protocol.spec, run.arrays("truth"), run.arrays("predictions"))
        np.testing.assert_array_equal(board.errors[name].press, wanted["ranked.press"])
        np.testing.assert_array_equal(board.errors[name].error, wanted["ranked.error"])


def test_a_run_without_its_arrays_is_shown_by_its_record(tmp_path, fabricate):
    run = store_run(tmp_path / "runs", fabricate(), contact_parts())
    (run.folder / "predictions.npz").unlink()
    (board,) = gather(tmp_path / "runs", tmp_path).boards
    assert len(board.records) == 1
    assert board.errors == {}


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        ({"protocols": ("exp9",)}, "unknown protocol 'exp9'"),
        ({"origin": "runs"}, "holds no complete run"),
        ({"origin": "board"}, "there is no board in"),
    ],
)
def test_mistakes_get_a_sentence(tmp_path, more, sentence):
    with pytest.raises(UserError, match=sentence):
        gather(tmp_path / "runs", tmp_path / "none", **more)


def test_an_empty_store_and_an_empty_board_are_nothing(tmp_path):
    with pytest.raises(UserError, match="no complete run to show"):
        gather(tmp_path / "runs", tmp_path)
    assert names(gather(tmp_path / "runs", tmp_path, protocols=("exp3",))) == {"exp3": 0}
