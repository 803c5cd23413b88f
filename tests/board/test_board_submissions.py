"""Committed records: small, valid, one per row and seed, and only of complete runs."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from stored_answers import store_run

from tactibench import UserError
from tactibench.board import (
    FOLDER,
    add,
    answers_file,
    compact,
    read_answers_file,
    read_submissions,
    refuse_twins,
    slot,
    split_ranked,
)
from tactibench.records import arrays_hash, open_run, text_of

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def stored(tmp_path, fabricate):
    """Keywords of ``fabricate`` -> a run in a store."""
    return lambda **more: store_run(tmp_path / "runs", fabricate(**more))


def committed(board):
    return sorted(path.name for path in (board / FOLDER).glob("*/*.json"))


def test_a_committed_record_is_valid_and_small(tmp_path, stored):
    run = stored()
    path, _ = add(run, tmp_path / "board")
    assert path == tmp_path / "board" / FOLDER / "exp1" / f"{run.record.name}.json"
    (record,) = read_submissions(tmp_path / "board", "exp1")
    assert record.identity.checksum is not None
    assert compact(record) == compact(run.record)
    assert "history" not in record.training
    assert isinstance(record.identity.sensor, str)
    assert record.metrics == run.record.metrics


def test_how_a_training_was_resumed_stays_on_its_machine(fabricate):
    record = fabricate()
    record.training.notes = {"checkpoint": "the checkpoint in a folder was ignored", "mixing": 0.5}
    assert compact(record).training.notes == {"mixing": 0.5}


def test_no_committed_record_names_a_folder_of_a_machine():
    folder = re.compile(r"(?<![\w.<])/\w+/\w")
    for path in (ROOT / "leaderboards" / FOLDER).glob("*/*.json"):
        assert not folder.search(path.read_text(encoding="utf-8")), path.name


def test_the_text_is_json_with_a_line_a_metric(fabricate):
    record = compact(fabricate())
    text = text_of(record)
    assert json.loads(text) == record.json_values()
    lines = [line.split(",")[0] for line in text.split("\n")]
    for row in record.metrics:
        assert f'["{row.metric}"' in lines
    assert sum(line.startswith('["') for line in lines) == len(record.metrics) + len(record.speed)
    record.metrics = []
    assert json.loads(text_of(record)) == record.json_values()


def test_answers_take_four_bytes_a_number_and_lose_none(tmp_path, stored):
    run = stored()
    path, _ = add(run, tmp_path / "board")
    with np.load(answers_file(path)) as file:
        assert file["depth"].dtype == np.float32
        assert file["xy"].dtype == np.float64  # fabricated places, which were not rounded
    answers, _ = split_ranked(read_answers_file(answers_file(path)))
    assert arrays_hash(answers) == run.record.identity.predictions_hash


def test_a_newer_run_of_a_row_and_seed_takes_the_place_of_the_older(tmp_path, stored):
    board = tmp_path / "board"
    add(stored(seed=0), board)
    add(stored(seed=1), board)
    _, replaced = add(stored(seed=0, error=0.01, name="exp1-unet-single-s0-newer"), board)
    assert [path.name[:20] for path in replaced] == ["exp1-unet-single-s0-"]
    assert len(committed(board)) == 2
    assert "exp1-unet-single-s0-newer.json" in committed(board)


def test_a_partial_run_is_refused(tmp_path, stored):
    with pytest.raises(UserError, match="is a partial run"):
        add(stored(partial=True), tmp_path / "board")
    assert not (tmp_path / "board").exists()


def test_changed_predictions_are_refused(tmp_path, stored):
    run = stored()
    np.savez(run.folder / "predictions.npz", values=np.arange(5.0))
    with pytest.raises(UserError, match="not what its record was made from"):
        add(open_run(run.folder.parent, run.name), tmp_path / "board")


def test_seeds_rows_and_presses_have_slots_of_their_own(fabricate):
    others = [
        fabricate(),
        fabricate(seed=1),
        fabricate(regime="multiple"),
        fabricate(sensor={"instance": 2}),
        fabricate(limits={"presses": 250}),
    ]
    assert len({slot(record) for record in others}) == len(others)
    refuse_twins(others)
    with pytest.raises(UserError, match="are both seed 0 of unet"):
        refuse_twins([fabricate(), fabricate(name="other")])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"name": "another"}, "file and folder must be called so"),
        ({"partial": True}, "partial run"),
        ({"schema": 99}, "is read by commit e6a49ac9"),
        ({"extra": 1}, "is no valid record"),
    ],
)
def test_a_file_that_is_no_committed_record_is_refused(tmp_path, fabricate, change, words):
    record = fabricate()
    path = tmp_path / FOLDER / "exp1" / f"{record.name}.json"
    path.parent.mkdir(parents=True)
    path.write_text(json.dumps({**record.json_values(), **change}))
    with pytest.raises(UserError, match=words):
        read_submissions(tmp_path, "exp1")
