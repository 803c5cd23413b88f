"""A run is in the store whole, or not at all."""

from __future__ import annotations

import errno
from pathlib import Path

import numpy as np
import pytest
from stored_answers import write_run

from tactibench import UserError
from tactibench.records import (
    PARTS,
    Arrays,
    Record,
    open_run,
    stored_runs,
)
from tactibench.records import store as module

Parts = dict[str, Arrays]


def test_a_run_is_found_by_name_folder_and_file(
    record: Record, parts: Parts, tmp_path: Path
) -> None:
    run = write_run(tmp_path, record, parts)
    name = record.name
    for asked in (name, str(run.folder), str(run.folder / "record.json")):
        found = open_run(tmp_path, asked)
        assert found.record == run.record
        for part in PARTS:
            np.testing.assert_array_equal(found.arrays(part)["values"], parts[part]["values"])
    assert [one.folder.name for one in stored_runs(tmp_path)] == [name]
    assert "truth" not in record.identity.stored, "the caller's record is left alone"


def test_names_that_are_not_there(record: Record, parts: Parts, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="it holds no run yet"):
        open_run(tmp_path / "none", "exp1")
    write_run(tmp_path, record, parts)
    with pytest.raises(UserError, match=f"did you mean '{record.name}'"):
        open_run(tmp_path, "exp1-mean-single-s0")


def test_a_half_written_run_is_invisible(
    record: Record, parts: Parts, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "full")

    monkeypatch.setattr(module, "write_record", full)
    with pytest.raises(OSError, match="full"):
        write_run(tmp_path, record, parts)
    assert not list(stored_runs(tmp_path))
    assert all(path.suffix == ".lock" for path in tmp_path.iterdir())
    monkeypatch.undo()
    # what a kill leaves is not shown either, and does not stop the next
    made = tmp_path / f".{record.name}.answers"
    made.mkdir()
    (made / "truth.npz").write_bytes(b"half")
    (tmp_path / "empty").mkdir()
    assert not list(stored_runs(tmp_path))
    write_run(tmp_path, record, parts)
    assert len(list(stored_runs(tmp_path))) == 1
    assert not made.exists()


def test_a_failed_replacement_keeps_the_run_before(
    record: Record, parts: Parts, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = write_run(tmp_path, record, parts)
    monkeypatch.setattr(module, "write_arrays", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        write_run(tmp_path, record.model_copy(update={"seed": 9}), parts)
    monkeypatch.undo()
    assert open_run(tmp_path, record.name).record == first.record
    write_run(tmp_path, record.model_copy(update={"seed": 9}), parts)
    assert open_run(tmp_path, record.name).record.seed == 9


def test_a_dishonest_record_is_not_written(record: Record, parts: Parts, tmp_path: Path) -> None:
    other = {**parts, "predictions": {"values": np.zeros(2)}}
    with pytest.raises(UserError, match="stored predictions"):
        write_run(tmp_path, record, other)
    assert all(path.suffix == ".lock" for path in tmp_path.iterdir())


def test_changed_arrays_are_noticed(record: Record, parts: Parts, tmp_path: Path) -> None:
    write_run(tmp_path, record, parts)
    run = open_run(tmp_path, record.name)
    np.savez_compressed(run.folder / "predictions.npz", values=np.arange(4.0))
    with pytest.raises(UserError, match="not what its record was made from"):
        run.arrays("predictions")
    (run.folder / "truth.npz").write_bytes(b"")
    with pytest.raises(UserError, match="damaged"):
        run.arrays("truth")
    (run.folder / "maps.npz").unlink()
    with pytest.raises(UserError, match="does not exist"):
        run.arrays("maps")


@pytest.mark.parametrize("content", ["", "{}", '{"schema": 2}', "[1]"])
def test_an_unreadable_record_is_named_when_asked_for_and_skipped_in_lists(
    record: Record, parts: Parts, tmp_path: Path, content: str
) -> None:
    write_run(tmp_path, record, parts)
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "record.json").write_text(content)
    assert [run.folder.name for run in stored_runs(tmp_path)] == [record.name]
    with pytest.raises(UserError, match="broken"):
        open_run(tmp_path, "broken")
