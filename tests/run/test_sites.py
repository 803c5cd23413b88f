"""Protocol `sites`: what trains, what is tested, and what a run says of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from briefly import time_briefly
from named_places import subsets, write_places
from small_data_sets import draft, header

from tactibench import UserError
from tactibench.datasets import Writer
from tactibench.frames import FrameSet
from tactibench.plugins import PluginHost
from tactibench.records import Record
from tactibench.run import NullReporter, RunPlan, RunRequest, execute, make_plan, rescore

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


@pytest.mark.parametrize(
    ("case", "sentence"),
    [
        ("unknown", "does not say which named places are touched"),
        ("half", r"row 1: thumb is 0.5, but a place is touched \(1\) or not \(0\)"),
        ("pairs alone", "0 trials to train"),
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
