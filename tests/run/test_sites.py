"""Protocol `sites`: what trains, what is tested, and what a run says of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from briefly import time_briefly
from named_places import subsets, write_places
from small_data_sets import draft, header

from tactibench import UserError
from tactibench.board import Source, make_truth
from tactibench.datasets import Writer
from tactibench.frames import FrameSet
from tactibench.plugins import PluginHost
from tactibench.protocols import load_protocol
from tactibench.records import Record, arrays_hash
from tactibench.run import (
    NullReporter,
    RunPlan,
    RunRequest,
    TestOptions,
    execute,
    make_plan,
    rescore,
)

TRIALS = 2 * (4 * 8 + 11 * 4)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_places(tmp_path_factory.mktemp("sites") / "places")


@pytest.fixture
def planned(recording: Path, tmp_path: Path) -> Any:
    def plan(model: str, regime: str = "single", data: Path = recording, **more: Any) -> RunPlan:
        request = RunRequest("sites", model, regime=regime, data=data, device="cpu", **more)
        return make_plan(request, PluginHost(), tmp_path / "cache", store=tmp_path / "runs")

    return plan


def counts(frames: FrameSet) -> set[int]:
    return {scene.sites.count for scene in frames.scenes if scene.sites is not None}


@pytest.mark.parametrize(
    ("regime", "trained", "tested"), [("single", {1}, {2, 3, 4}), ("pairs", {1, 2}, {3, 4})]
)
def test_a_regime_learns_from_few_places_and_is_tested_on_more(
    planned: Any, regime: str, trained: set[int], tested: set[int]
) -> None:
    frames = planned("mean", regime).frames
    assert (counts(frames.fit[0]), counts(frames.test[0])) == (trained, tested)
    assert frames.count("fit") + frames.count("test") == TRIALS
    assert set(frames.test[0].groups) == set(map(str, tested))


def test_no_training_sees_a_tested_set_of_places_or_a_tested_session(planned: Any) -> None:
    folds = planned("mean", "all").frames.folds
    for fold in folds:
        (fit,), (test,) = fold.fit, fold.test
        if test.name == "session":
            assert not set(fit.names) & set(test.names)
            assert len(fit.names) == len(test.names) == TRIALS // 2
        else:
            assert not {scene.sites for scene in fit.scenes} & {s.sites for s in test.scenes}
            assert set(test.clusters) == {str(scene.sites) for scene in test.scenes}
    by_test = {name: [n for f in folds for s in f.test if s.name == name for n in s.names]
               for name in ("recorded", "session")}  # fmt: skip
    assert all(len(set(names)) == len(names) == TRIALS for names in by_test.values())
    assert len(folds) == 5 + 2


@pytest.mark.parametrize(("model", "regime"), [("nearest", "all"), ("mean", "single")])
def test_a_run_is_scored_by_number_of_places(
    planned: Any, model: str, regime: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    time_briefly(monkeypatch.setattr)
    run = execute(planned(model, regime), NullReporter())
    rows = {row.group: row for row in run.record.metrics if row.metric == "exact"}
    if regime == "all":
        assert list(rows) == [
            *("1", "2", "3", "4", "all"),
            *("session:1", "session:2", "session:3", "session:4", "session"),
        ]
        assert (rows["all"].clusters, rows["all"].n) == (len(subsets()), TRIALS)
        assert rows["all"].value == 0.0  # the nearest trial never has a set that it did not see
        assert rows["session"].value > 0.7
    else:
        assert list(rows) == ["2", "3", "4", "all"]
        assert rows["all"].value == 0.0
    assert rescore(run).metrics == run.record.metrics


def trained(planned: Any, patch: pytest.MonkeyPatch, model: str, **values: str) -> Record:
    time_briefly(patch.setattr)
    return execute(planned(model, parameters={"model": values}), NullReporter()).record


@pytest.mark.parametrize(
    ("model", "mixed"),
    [("kernel", True), ("superpose", False), pytest.param("pins", True, marks=pytest.mark.slow)],
)
def test_several_places_are_learned_from_trials_of_one(
    planned: Any, monkeypatch: pytest.MonkeyPatch, model: str, mixed: bool
) -> None:
    record = trained(planned, monkeypatch, model)
    assert record.metric("exact", "all").value > 0.8
    assert record.training.prior == "plain addition"
    assert (record.training.notes["mixing"] > 1) is mixed


def test_a_model_without_mixing_learns_from_its_trials_alone(
    planned: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = trained(planned, monkeypatch, "kernel", mixing="no")
    assert record.training.notes == {"trials": 64, "mixing": 0}
    assert record.training.prior == "none"


def test_a_quick_run_and_a_shorter_one_are_possible(planned: Any) -> None:
    plan = planned("mean", "all", quick=True)
    assert plan.frames.count("test") <= (5 + 2) * 40
    assert planned("mean", presses=10).frames.count("fit") == 10


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_places(tmp_path_factory.mktemp("other") / "next-day", repeats=2, noise=0.3)


def test_another_recording_is_tested_by_what_this_one_taught(planned: Any, other: Path) -> None:
    frames = planned("mean", test=TestOptions(data=other)).frames
    (fit,), (test,) = frames.fit, frames.test
    assert (counts(fit), counts(test)) == ({1}, {2, 3, 4})
    assert (len(fit.names), len(test.names)) == (2 * 4 * 8, 2 * 11 * 2)
    assert frames.test_identity not in (None, frames.sensor_identity)
    folds = planned("mean", "all", test=TestOptions(data=other)).frames.folds
    assert [fold.test[0].name for fold in folds] == ["recorded"] * 5 + ["session"]
    for fold in folds[:5]:
        fit, test = fold.fit[0], fold.test[0]
        assert not {scene.sites for scene in fit.scenes} & {scene.sites for scene in test.scenes}
    assert len(folds[5].fit[0].names) == TRIALS
    assert sum(len(fold.test[0].names) for fold in folds[:5]) == len(folds[5].test[0].names)


def test_a_run_on_another_recording_says_so_and_its_row_is_verified(
    planned: Any, other: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    time_briefly(monkeypatch.setattr)
    run = execute(planned("kernel", test=TestOptions(data=other)), NullReporter())
    assert run.record.metric("exact", "all").value > 0.6
    assert run.record.test_sensor is not None
    assert run.record.test_sensor.description.startswith("recording ")
    assert rescore(run).metrics == run.record.metrics
    source = Source(PluginHost(), tmp_path / "cache", other)
    protocol = load_protocol("sites")
    truth = make_truth(run.record, protocol, source, None)
    assert arrays_hash(truth) == run.record.identity.stored["truth"]
    # The tested folder is enough, also where it could not train.
    several = write_places(tmp_path / "several", singles=0)
    source = Source(PluginHost(), tmp_path / "cache", several)
    assert arrays_hash(make_truth(run.record, protocol, source, None)) != arrays_hash(truth)


@pytest.mark.parametrize(
    ("case", "sentence"),
    [
        ("same", "is the recording that is trained on"),
        ("places", "thumb, palm, wrist, knuckle.*import both with the same names"),
        ("shots", "shows no labelled frames of another recording"),
    ],
)
def test_another_recording_that_does_not_fit_is_one_sentence(
    planned: Any, recording: Path, other: Path, tmp_path: Path, case: str, sentence: str
) -> None:
    folder = {"same": recording, "shots": other}.get(case, tmp_path / "glove")
    if case == "places":
        write_places(folder, places=("thumb", "palm", "wrist", "elbow"))
    options = TestOptions(data=folder, shots=5 * (case == "shots"))
    with pytest.raises(UserError, match=sentence):
        planned("mean", test=options)


@pytest.mark.parametrize(
    ("case", "sentence"),
    [
        ("unknown", "does not say which named places are touched"),
        ("half", r"row 1: thumb is 0.5, but a place is touched \(1\) or not \(0\)"),
        ("pairs alone", "has no trials to train or it none to test"),
    ],
)
def test_what_does_not_fit_is_one_sentence(
    planned: Any, tmp_path: Path, case: str, sentence: str
) -> None:
    folder = write_places(
        tmp_path / "data",
        singles=0 if case == "pairs alone" else 2,
        touched=0.5 if case == "half" else 1.0,
    )
    if case == "unknown":
        folder = tmp_path / "pairs"
        with Writer(folder, header(), fsync=False) as writer:
            writer.add_many([draft(number) for number in range(4)])
    with pytest.raises(UserError, match=sentence):
        planned("mean", data=folder)


def test_named_places_are_no_contacts(recording: Path, tmp_path: Path) -> None:
    request = RunRequest("exp1", "kernel", data=recording, device="cpu")
    with pytest.raises(UserError, match=r"by named places, .* run protocol 'sites' on it"):
        make_plan(request, PluginHost(), tmp_path / "cache", store=tmp_path / "runs")
