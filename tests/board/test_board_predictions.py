"""Answers beside a record: lossless, and the errors that a board ranks by."""

from __future__ import annotations

import numpy as np
import pytest
from stored_answers import answered_parts, store_run

from tactibench import UserError
from tactibench.board import (
    FOLDER,
    add,
    answers_file,
    read_answers_file,
    read_press_errors,
)
from tactibench.records import arrays_hash, write_arrays


@pytest.fixture
def stored(tmp_path, fabricate):
    def made(**more):
        parts = answered_parts(0.06, frames=5, missing=(2,))
        return store_run(tmp_path / "runs", fabricate(**more), parts)

    return made


def test_answers_keep_their_hash_and_the_errors_are_those_of_presses(tmp_path, stored) -> None:
    run, expected = stored(), {0: 0.06, 1: 0.06, 2: 1.5, 3: 0.06, 4: 0.06}  # half the gate: missed
    path, _ = add(run, tmp_path / "board")
    arrays = read_answers_file(answers_file(path))
    answers = {name: a for name, a in arrays.items() if not name.startswith("ranked.")}
    assert arrays_hash(answers) == run.record.identity.predictions_hash
    found = read_press_errors(answers_file(path))
    assert found.press.tolist() == [f"singles-{k}" for k in expected]
    assert found.error == pytest.approx(list(expected.values()))


def test_a_replaced_record_takes_its_answers_along(tmp_path, stored) -> None:
    add(stored(), tmp_path / "board")
    add(stored(name="exp1-newer"), tmp_path / "board")
    names = sorted(path.name for path in (tmp_path / "board" / FOLDER / "exp1").iterdir())
    assert names == ["exp1-newer.json", "exp1-newer.npz"]


def test_another_version_of_the_protocol_is_refused(tmp_path, stored) -> None:
    run = stored()
    run.record.protocol.hash = "ab"
    with pytest.raises(UserError, match="run the protocol again"):
        add(run, tmp_path / "board")


def test_no_file_no_errors_and_damage_is_told(tmp_path) -> None:
    path = tmp_path / "x.npz"
    assert read_press_errors(path) is None
    path.write_bytes(b"no archive")
    with pytest.raises(UserError, match="is no archive of arrays"):
        read_press_errors(path)
    press = np.array(["a", "b"])
    write_arrays(path, {"ranked.press": press, "ranked.error": np.array([1.0, np.nan])})
    with pytest.raises(UserError, match="one finite error a press"):
        read_press_errors(path)


def test_a_name_that_no_file_may_have_is_refused_before_anything_is_written(
    tmp_path, stored
) -> None:
    run = stored()
    run.record.name = "../../elsewhere"
    with pytest.raises(UserError, match="neither markup nor a path"):
        add(run, tmp_path / "board")
    assert not (tmp_path / "board").exists()
