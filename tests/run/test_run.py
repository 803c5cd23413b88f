"""A run from request to record, with a tiny sensor and model."""

from __future__ import annotations

import errno
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactibench import Pose, Scene, UserError
from tactibench.frames import D_PRIME
from tactibench.records import StoredRun, open_run, run_names, unpack_contacts, unscored_run
from tactibench.run import NullReporter, execute, metric_differences, rescore, score_arrays
from tactibench.run import timing as speed

Run = Callable[..., StoredRun]


def value(run: StoredRun, metric: str, group: str = "all") -> Any:
    return run.record.value(metric, group)


@pytest.mark.parametrize("protocol", ["exp1", "exp2", "exp3"])
def test_a_run_ends_in_a_valid_record(
    run: Run, planned: Any, tmp_path: Path, protocol: str
) -> None:
    done = run(protocol)
    again = open_run(tmp_path / "runs", planned(protocol).name)
    assert again.record == done.record
    truth, found = again.arrays("truth"), unpack_contacts(again.arrays("predictions"))
    assert len(found) == {"exp1": 20, "exp2": 28 + 19, "exp3": 40 + 12}[protocol]
    assert len(set(truth["press"])) == len(found)
    # The tiny sensor rounds to 1/18 mm with half a step of noise before.
    for one, two in zip(unpack_contacts(truth), found, strict=True):
        np.testing.assert_allclose(one.xy, two.xy, atol=1 / 18 + 1e-9)
    assert value(done, "missed") == 0.0
    assert done.record.data.train == 30
    assert done.record.partial is False


def test_metrics_are_what_the_stored_arrays_say(run: Run) -> None:
    done = run("exp1")
    truth, found = done.arrays("truth"), done.arrays("predictions")
    by_hand = float(np.abs(truth["depth"] - found["depth"]).mean())
    assert value(done, "mae_mm", "z") == pytest.approx(by_hand)
    # No heat at all against a surface as deep as the press, kept as float16.
    heat, surface = done.arrays("maps")["maps"], done.arrays("maps")["surface"]
    assert heat.shape == surface.shape == (20, 64, 64)
    rms = float(np.sqrt((surface.astype(float)[:, 0, 0] ** 2).mean()))
    assert value(done, "surface_rmse_mm") == pytest.approx(rms)
    assert truth["bound"].shape == (20, 3)


@pytest.mark.long
def test_a_limit_stands_below_the_threshold_where_the_sensor_knows_it(
    run: Run, planned: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from tiny_tactile.parts import TinySensor

    def deviance(_self: Any, scene: Scene, _nuisances: Any = ()) -> float:
        (first, *_), (second, *_) = scene.indenter.offsets
        return float((4 * (second - first)) ** 4)

    assert run("exp2", store="before").record.metric("limit_mm", "all") is None
    monkeypatch.setattr(TinySensor, "deviance", deviance)
    done = run("exp2")
    names = list(dict.fromkeys(row.metric for row in done.record.metrics))
    assert names.index("limit_mm") == names.index("threshold_mm") + 1
    row = done.record.metric("limit_mm", "all")
    assert row is not None
    assert (row.n, row.clusters) == (24, 24)
    assert [row.value, row.low, row.high] == pytest.approx([np.sqrt(D_PRIME) / 4] * 3, rel=1e-4)
    truth, spec = done.arrays("truth"), planned("exp2").spec
    assert np.isnan(truth["limit"][-4:]).all()  # of the catch trials
    again = score_arrays(spec, truth, done.arrays("predictions"), {})
    assert row in again
    assert run("exp1").record.metric("limit_mm", "all") is None


def test_a_model_sees_no_truth_in_a_test_frame(
    run: Run, tiny: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(speed, "BATCHES", (1, 8))
    run("exp2")
    assert tiny.TinyModel.shown
    frames = [frame for call in tiny.TinyModel.shown for frame in call]
    assert {len(call) for call in tiny.TinyModel.shown} == {1, 8}, "single and offline"
    for frame in frames:
        assert frame.pose == Pose()
        assert frame.timestamp == 0.0
        assert type(frame.image) is np.ndarray, "a mapped image knows its file"
        assert frame.image.base is None


def test_test_frames_are_no_training_frames(planned: Any) -> None:
    plan = planned("exp1", regime="multiple")
    poses = {w.role: {s.pose for s in w.scenes} for w in plan.frames}
    fit = {s.pose for w in plan.frames.fit for s in w.scenes}
    assert [w.name for w in plan.frames.fit] == ["singles", "duals-train", "triples-train"]
    assert len(fit) == 30 + 20 + 20
    assert not fit & poses["validation"]
    assert not (fit | poses["validation"]) & poses["test"]


@pytest.mark.parametrize("regime", ["single", pytest.param("multiple", marks=pytest.mark.long)])
def test_weights_are_trained_once_for_all_three(run: Run, tiny: Any, regime: str) -> None:
    runs = [run(name, regime=regime) for name in ("exp1", "exp2", "exp3")]
    assert tiny.TinyModel.fits == [30 if regime == "single" else 70]
    assert len({one.record.identity.weights_hash for one in runs}) == 1
    assert [one.record.training.reused for one in runs] == [False, True, True]
    assert all(one.record.training.history for one in runs)


@pytest.mark.long
def test_training_keys_are_those_of_the_shipped_protocols_too(host: Any, tmp_path: Path) -> None:
    from tactibench.run import RunRequest, make_plan

    for regime in ("single", "multiple"):
        plans = [
            make_plan(RunRequest(name, "tiny", regime), host, tmp_path)
            for name in ("exp1", "exp2", "exp3")
        ]
        assert len({plan.frames.training_key() for plan in plans}) == 1
        assert len({plan.weights.folder for plan in plans}) == 1
        assert len({plan.name for plan in plans}) == 3


def test_what_changes_weights_and_what_does_not(planned: Any) -> None:
    base = planned().weights.folder
    changes = [
        {"seed": 1},
        {"regime": "multiple"},
        {"quick": True},
        {"parameters": {"model": {"width": "9"}}},
        {"parameters": {"sensor": {"offset": "1.0"}}},
        {"model": "tiny-one"},
    ]
    folders = {planned(**change).weights.folder for change in changes}
    assert len(folders) == len(changes)
    assert base not in folders
    assert planned(limit=3).weights.folder == base


@pytest.mark.parametrize("key", ["depth_max_mm = 6.0", "dome_radius_mm = 20.0", "pitch_mm = 0.4"])
def test_weights_depend_on_what_the_model_is_told(planned: Any, mini: Any, key: str) -> None:
    path = Path(mini("exp1"))
    before = planned("exp1")
    name, _, number = key.partition(" = ")
    path.write_text(path.read_text().replace(key, f"{name} = {float(number) + 0.1}", 1))
    after = planned("exp1")
    assert after.weights.folder != before.weights.folder


@pytest.mark.long  # two trainings; `scripts/golden` compares runs in every CI
def test_same_seed_same_predictions_in_another_cache(run: Run) -> None:
    one = run("exp2", cache="a", store="a")
    two = run("exp2", cache="b", store="b")
    for key in ("weights_hash", "predictions_hash", "data", "test_frames"):
        assert getattr(one.record.identity, key) == getattr(two.record.identity, key)
    assert one.record.metrics == two.record.metrics
    three = run("exp2", cache="a", store="c", seed=1)
    assert three.record.identity.weights_hash != one.record.identity.weights_hash
    assert three.record.identity.data == one.record.identity.data


def test_an_interrupted_training_goes_on(run: Run, tiny: Any, planned: Any, tmp_path: Path) -> None:
    undisturbed = run("exp1", cache="a", store="a")
    tiny.TinyModel.fail_in_fit = True
    with pytest.raises(KeyboardInterrupt):
        run("exp1", cache="b", store="stopped")
    assert run_names(tmp_path / "stopped") == []
    assert planned(cache="b").weights.begun
    tiny.TinyModel.fail_in_fit = False
    tiny.TinySensor.pressed = 0
    resumed = run("exp1", cache="b", store="stopped")
    assert tiny.TinySensor.pressed == 20, "only the test presses were missing"
    assert not planned(cache="b").weights.begun, "checkpoints are removed"
    for key in ("weights_hash", "predictions_hash"):
        assert getattr(resumed.record.identity, key) == getattr(undisturbed.record.identity, key)
    assert resumed.record.metrics == undisturbed.record.metrics


@pytest.mark.long
@pytest.mark.parametrize("damage", ["weights", "gone", "manifest", "empty", "other"])
def test_damaged_weights_are_trained_again(run: Run, tiny: Any, planned: Any, damage: str) -> None:
    first = run("exp1")
    folder = planned().weights.folder
    weights, manifest = folder / "offset.json", folder / "manifest.json"
    if damage == "weights":
        weights.write_text("1.0")
    elif damage == "gone":
        weights.unlink()
    elif damage == "manifest":
        manifest.write_text("{")
    elif damage == "empty":
        manifest.write_text('{"files": {}}')
    else:
        manifest.write_text(manifest.read_text().replace('"seed": 0', '"seed": 7'))
    again = run("exp1", store="again")
    assert len(tiny.TinyModel.fits) == 2
    assert again.record.identity.weights_hash == first.record.identity.weights_hash


@pytest.mark.parametrize(
    ("behave", "said"),
    [
        ("nothing", "gave 0 answers for one frame"),
        ("twice", "gave 2 answers for one frame"),
        ("none", "answered NoneType where Contacts is asked"),
        ("nan-maps", "a map with a value that is not finite"),
        ("small-maps", "maps of shape"),
        ("diverge", "its loss was not finite"),
    ],
)
def test_models_that_misbehave(run: Run, tiny: Any, tmp_path: Path, behave: str, said: str) -> None:
    tiny.TinyModel.behave = behave
    with pytest.raises(UserError, match=said):
        run("exp1")
    assert run_names(tmp_path / "runs") == []


def test_more_contacts_than_declared(run: Run) -> None:
    with pytest.raises(UserError, match="at most 1 contacts per frame, but gave 2"):
        run("exp2", "tiny-one")


def test_scoring_again_is_identical(
    run: Run, planned: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = run("exp2")
    spec = planned("exp2").protocol.spec
    arrays = (done.arrays(part) for part in ("truth", "predictions", "maps"))
    assert not metric_differences(done.record.metrics, score_arrays(spec, *arrays))
    with pytest.raises(UserError, match="TACTIBENCH_PROTOCOLS"):
        rescore(done)
    monkeypatch.setenv("TACTIBENCH_PROTOCOLS", str(tmp_path / "protocols"))
    assert rescore(done) == done.record
    changed = [
        done.record.metrics[0].model_copy(update={"value": 9.0}),
        *done.record.metrics[1:],
    ]
    assert len(metric_differences(done.record.metrics, changed)) == 1


def test_wrong_metrics_are_refused_before_any_work(run: Run, tiny: Any, mini: Any) -> None:
    path = Path(mini("exp1"))
    path.write_text(path.read_text().replace('"mae_mm"', '"mae_cm"'))
    with pytest.raises(UserError, match="did you mean 'mae_mm'"):
        run("exp1")
    assert tiny.TinySensor.pressed == 0


def test_bounds_and_surfaces_are_read_from_the_cache(run: Run, tiny: Any, monkeypatch: Any) -> None:
    one = run("exp1")
    monkeypatch.setattr(tiny.TinySensor, "surface", lambda *_: pytest.fail("computed again"))
    monkeypatch.setattr(tiny.TinySensor, "bound", lambda *_: pytest.fail("computed again"))
    assert run("exp1", store="again").record.metrics == one.record.metrics


@pytest.mark.parametrize("error", [ValueError("nan"), UserError("a broken invariant.")])
def test_answers_that_cannot_be_scored_are_kept_and_scored_later(
    run: Run, planned: Any, tiny: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Any
) -> None:
    def fail(*_: Any) -> Any:
        raise error

    monkeypatch.setattr("tactibench.run.score.score_arrays", fail)
    name, store = planned("exp1").name, tmp_path / "runs"
    command = f"`tactibench score {name} --store {store}`"
    with pytest.raises(UserError, match=f"kept: the same command, or {command}"):
        run("exp1")
    assert run_names(store) == []
    monkeypatch.setattr("tactibench.run.score.score_arrays", score_arrays)
    tiny.TinyModel.shown.clear()
    done = run("exp1")
    assert tiny.TinyModel.shown == [], "the model is not asked again"
    assert value(done, "missed") == 0.0
    assert run_names(store) == [name]
    assert unscored_run(store, name) is None


def test_a_fresh_run_does_not_score_what_was_kept(
    planned: Any, tiny: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = planned("exp1")
    with monkeypatch.context() as broken:
        broken.setattr("tactibench.run.score.score_arrays", lambda *_: 1 / 0)
        with pytest.raises(UserError, match="ZeroDivisionError"):
            execute(plan, NullReporter())
    tiny.TinyModel.shown.clear()
    execute(plan, NullReporter(), fresh=True)
    assert tiny.TinyModel.shown


def test_fresh_makes_frames_and_weights_anew(run: Run, planned: Any, tiny: Any) -> None:
    first = run("exp1")
    tiny.TinySensor.pressed = 0
    again = execute(planned("exp1"), NullReporter(), fresh=True)
    assert tiny.TinyModel.fits == [30, 30]
    assert tiny.TinySensor.pressed == 30 + 10 + 20
    assert again.record.metrics == first.record.metrics
    assert not again.record.training.reused


def test_a_store_that_cannot_be_written_is_told_before_the_training(
    run: Run, tiny: Any, tmp_path: Path
) -> None:
    (tmp_path / "blocked").write_text("a file, which also stops root")
    with pytest.raises(OSError, match="blocked"):
        run("exp1", store="blocked")
    assert (tiny.TinyModel.fits, tiny.TinySensor.pressed) == ([], 0)


def test_a_run_stopped_after_its_answers_does_not_ask_the_model_again(
    run: Run, tiny: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as stopped:
        stopped.setattr("tactibench.run.execution.simulator_error", lambda _: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            run("exp1")
    tiny.TinyModel.shown.clear()
    run("exp1")
    calls = [len(frames) for frames in tiny.TinyModel.shown]
    run("exp1", store="other")
    assert len(tiny.TinyModel.shown) - len(calls) > len(calls), "predicted in another store"
    assert not list(tmp_path.rglob("*.predictions.npz"))


def test_a_full_disk_while_the_score_is_stored_keeps_the_answers(
    planned: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, store = planned("exp1"), tmp_path / "runs"

    def full(*_: Any) -> Any:
        raise OSError(errno.ENOSPC, "full")

    with monkeypatch.context() as disk:
        disk.setattr("tactibench.run.score.complete_run", full)
        with pytest.raises(OSError, match="full"):
            execute(plan, NullReporter())
    assert unscored_run(store, plan.name) is not None
