"""Each protocol draws its own pictures beside the record, of runs that answered the same frames."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from changed_record import changed_record
from tiny_lab import Lab, tiny_commands

from tactibench.board import label_of
from tactibench.cli.main import call
from tactibench.records import StoredRun, stored_runs
from tactibench.report import draw_pictures, new_figure, runs_beside

MODULE = "tactibench.report.run_pictures"
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """Each protocol in miniature, run with the tiny model as it is, and trained longer for those
    whose pictures show several runs."""
    folder = tmp_path_factory.mktemp("pictures")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TACTIBENCH_CACHE", str(folder / "cache"))
        tiny_commands(patch.setattr, Lab(folder / "lab").protocols)
        for protocol, epochs in (("exp1", 6), ("exp2", 6), ("exp2", 7), ("exp3", 6), ("exp3", 7)):
            options = ["--param", f"model.epochs={epochs}", "--store", str(folder / "runs")]
            options += ["--board", str(folder / "board")]
            assert call(["run", protocol, "--model", "tiny", *options]) == 0
        yield folder / "runs"


@pytest.mark.long
@pytest.mark.parametrize(
    ("protocol", "own"), [("exp1", "errors.png"), ("exp2", "distance.png"), ("exp3", "triple.png")]
)
def test_a_run_leaves_its_pictures(store, protocol, own):
    runs = [run for run in stored_runs(store) if run.record.protocol.id == protocol]
    assert runs
    for run in runs:
        drawn = {path.name for path in run.folder.glob("*.png")}
        assert drawn == {"frame.png", own}  # the tiny model has no heatmap to show as relief
        assert all((run.folder / name).read_bytes().startswith(PNG) for name in drawn)


@pytest.mark.long
def test_only_runs_that_answered_the_same_frames_share_a_picture(store, monkeypatch):
    runs = list(stored_runs(store))
    pairs = [run for run in runs if run.record.protocol.id == "exp2"]
    seen: list[str] = []

    def record_series(series, **_more):
        seen.extend(one.label for one in series)
        return new_figure(1, 1)

    monkeypatch.setattr(f"{MODULE}.distance_figure", record_series)
    others = [run for run in runs if run.folder != pairs[0].folder]
    draw_pictures(pairs[0], others)
    assert seen == sorted(label_of(run.record) for run in pairs)


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


def test_the_newest_of_a_label_is_taken(make):
    old = make(model="cnn", created="2026-01-01T00:00:00+00:00")
    new = make(model="cnn", created="2026-01-02T00:00:00+00:00", error=0.2)
    assert runs_beside(make().record, [new, old]) == [new]


@pytest.mark.parametrize(
    "other", [{"seed": 1}, {"limits": {"presses": 250}}, {"model": "unet"}], ids=str
)
def test_other_seeds_presses_and_the_run_itself_are_left_out(make, other):
    assert runs_beside(make().record, [make(**{"model": "cnn", **other})]) == []
