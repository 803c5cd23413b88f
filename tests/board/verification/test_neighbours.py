"""The place of a submission among the records beside it, and the two that cannot be neighbours."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import forged
import pytest

from tactibench import UserError
from tactibench.board import Neighbours, find_neighbours
from tactibench.records import Record

SUBMITTED = forged.base_file("plain")


def beside(folder: Path, name: str, change: Callable[[dict[str, Any]], None]) -> Neighbours:
    """Return the place of a copy of a committed record that was changed."""
    values = json.loads(SUBMITTED.read_text(encoding="utf-8"))
    change(values)
    path = folder / f"{name}.json"
    path.write_text(json.dumps(values), encoding="utf-8")
    return find_neighbours(Record.model_validate(values), path)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copy(SUBMITTED, tmp_path)
    (tmp_path / "damaged.json").write_text("[")
    return tmp_path


def test_another_seed_joins_the_row(folder: Path) -> None:
    place = beside(folder, "other", forged.put("seed", 7))
    assert place == Neighbours(row=(0,), table=1, other_frames=0)
    assert place.note == "joins the row with seed 0, in a table with 1 other records"


def test_another_model_begins_a_row(folder: Path) -> None:
    assert beside(folder, "other", forged.put("model.name", "mine")) == Neighbours((), 1, 0)


def test_a_made_up_hash_of_frames_is_said(folder: Path) -> None:
    place = beside(folder, "other", forged.put("identity.data", ["ab" * 32]))
    assert place == Neighbours(row=(), table=0, other_frames=1)
    assert "table of its own: 1 records of this test state another hash" in place.note


def test_another_sensor_begins_a_table(folder: Path) -> None:
    place = beside(folder, "other", forged.put("sensor.parameters.blur", 1.0))
    assert place.note == "begins a row, in a new table"


def test_a_second_record_of_one_row_and_seed_is_refused(folder: Path) -> None:
    with pytest.raises(UserError, match="is seed 0 of a row that has it from"):
        beside(folder, "other", forged.put("created", "2026-11-23T00:00:00+00:00"))


def test_a_name_that_differs_in_capitals_alone_is_refused(folder: Path) -> None:
    with pytest.raises(UserError, match="differ in capitals alone"):
        beside(folder, SUBMITTED.stem.upper(), forged.put("seed", 7))
