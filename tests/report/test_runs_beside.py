"""Other runs that a picture shows beside a run, and in what order while there is room."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from changed_record import changed_record

from tactibench.records import StoredRun
from tactibench.report import runs_beside

ASKED = {
    "identity.test_frames": ["f"],
    "identity.protocol": "exp3@1",
    "identity.quick": False,
    "identity.limit": None,
}


@pytest.fixture
def make(fabricate):
    """Keywords of ``fabricate`` -> a run that answered the same frames."""

    def made(**more: Any) -> StoredRun:
        record = changed_record(fabricate("exp3", **more), ASKED)
        return StoredRun(Path(record.name), record)

    return made


def models(runs):
    return [run.record.model.name for run in runs]


def test_trivial_models_come_last_and_plain_settings_first(make):
    others = [
        make(model="mean"),
        make(model="cnn", settings={"width": 8}),
        make(model="vgnn", regime="multiple"),
        make(model="superpose"),
    ]
    assert models(runs_beside(make().record, others)) == ["superpose", "vgnn", "cnn", "mean"]


def test_the_newest_of_a_label_is_taken(make):
    old = make(model="cnn", created="2026-01-01T00:00:00+00:00")
    new = make(model="cnn", created="2026-01-02T00:00:00+00:00", error=0.2)
    assert runs_beside(make().record, [new, old]) == [new]


@pytest.mark.parametrize(
    "other", [{"seed": 1}, {"limits": {"presses": 250}}, {"model": "unet"}], ids=str
)
def test_other_seeds_presses_and_the_run_itself_are_left_out(make, other):
    assert runs_beside(make().record, [make(**{"model": "cnn", **other})]) == []


def test_other_frames_are_left_out(make):
    other = make(model="cnn")
    other.record.identity.test_frames = ["g"]
    assert runs_beside(make().record, [other]) == []
