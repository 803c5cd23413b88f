"""Each protocol draws its own pictures beside the record, of runs that answered the same frames."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from changed_record import changed_record
from tiny_lab import Lab, tiny_commands

from tactibench.board import label_of
from tactibench.cli.main import call
from tactibench.records import RECORD, StoredRun, stored_runs
from tactibench.report import draw_pictures, new_figure, runs_beside, update_pictures

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
def test_pictures_are_drawn_again_only_when_a_run_in_them_is_newer(store, monkeypatch):
    drawn: list[str] = []
    monkeypatch.setattr(f"{MODULE}.draw_pictures", lambda run, _: drawn.append(run.folder.name))
    runs = [run for run in stored_runs(store) if run.record.protocol.id == "exp2"]
    single = next(run for run in stored_runs(store) if run.record.protocol.id == "exp1")
    for run in runs:  # both records are older than both pictures: as if each were drawn again
        for picture in run.folder.glob("*.png"):
            os.utime(picture, (2e9, 2e9))
    first, second = runs
    assert {path.name for path in update_pictures(first, [second])} == {"frame.png", "distance.png"}
    assert not drawn
    os.utime(second.folder / RECORD, (3e9, 3e9))  # the picture of both has become old
    update_pictures(first, [second, single])
    assert drawn == [first.folder.name]
    os.utime(single.folder / RECORD, (3e9, 3e9))  # another protocol's run is in no picture of it
    update_pictures(first, [single])
    assert drawn == [first.folder.name]
    (first.folder / "frame.png").unlink()
    (first.folder / "distance.png").unlink()
    update_pictures(first, [])
    assert drawn == [first.folder.name] * 2


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


@pytest.mark.long
def test_a_run_of_another_protocol_version_draws_nothing(store):
    run = next(stored_runs(store))
    run.record.protocol.hash = "0" * 64
    assert draw_pictures(run, []) == []


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
