"""A run from request to record, with a tiny sensor and model."""

from __future__ import annotations

import errno
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stubs import StubModel
from threadpoolctl import threadpool_info, threadpool_limits

from tactibench import Frame, Pose, Scene, UserError
from tactibench.frames import D_PRIME
from tactibench.records import (
    StoredRun,
    open_run,
    run_names,
    unpack_contacts,
    unscored_run,
)
from tactibench.run import (
    EXAMPLES,
    AnswerRules,
    NullReporter,
    example_arrays,
    execute,
    metric_differences,
    predict_frames,
    rescore,
    score_arrays,
)
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
    assert done.record.metric("limit_mm", "all") is None, "the sensor knows none"


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


def test_training_and_answers_use_one_thread_whatever_the_machine_has(
    run: Run, tiny: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: dict[str, list[int]] = {"fit": [], "predict": []}
    for name, threads in seen.items():
        original = getattr(tiny.TinyModel, name)

        def watched(
            model: Any, *data: Any, original: Any = original, threads: Any = threads, **more: Any
        ) -> Any:
            threads += [pool["num_threads"] for pool in threadpool_info()]
            return original(model, *data, **more)

        monkeypatch.setattr(tiny.TinyModel, name, watched)
    with threadpool_limits(2):
        run("exp1")
        assert 2 in {pool["num_threads"] for pool in threadpool_info()}
    fitted, answered = seen.values()
    assert set(fitted) == {1}
    assert set(answered[: len(fitted)]) == {1}, "what is timed later may use more"


@pytest.mark.long
def test_a_limit_stands_below_the_threshold_where_the_sensor_knows_it(
    run: Run, mini: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from tiny_tactile.parts import TinySensor

    path = Path(mini("exp2"))
    few = re.compile(r"^(names|metrics) = \[.*?\]", re.MULTILINE | re.DOTALL)
    path.write_text(few.sub(r'\1 = ["threshold_mm"]', path.read_text()))

    def deviance(_self: Any, scene: Scene, _nuisances: Any = ()) -> float:
        (first, *_), (second, *_) = scene.indenter.offsets
        return float((4 * (second - first)) ** 4)

    monkeypatch.setattr(TinySensor, "deviance", deviance)
    done = run(str(path))
    names = list(dict.fromkeys(row.metric for row in done.record.metrics))
    assert names.index("limit_mm") == names.index("threshold_mm") + 1
    row = done.record.metric("limit_mm", "all")
    assert row is not None
    assert (row.n, row.clusters) == (24, 24)
    assert [row.value, row.low, row.high] == pytest.approx([np.sqrt(D_PRIME) / 4] * 3, rel=1e-4)
    assert np.isnan(done.arrays("truth")["limit"][-4:]).all()  # of the catch trials


@pytest.mark.usefixtures("unscored")
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
        assert frame.force is None
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
    single = [s for w in planned("exp2").frames.fit for s in w.scenes]
    assert {len(scene.indenter.offsets) for scene in single} == {1}


@pytest.mark.parametrize("regime", ["single", pytest.param("multiple", marks=pytest.mark.long)])
@pytest.mark.usefixtures("unscored")
def test_weights_are_trained_once_for_all_three(run: Run, tiny: Any, regime: str) -> None:
    runs = [run(name, regime=regime) for name in ("exp1", "exp2", "exp3")]
    assert tiny.TinyModel.fits == [30 if regime == "single" else 70]
    assert len({one.record.identity.weights_hash for one in runs}) == 1
    assert [one.record.training.reused for one in runs] == [False, True, True]
    assert all(one.record.training.history for one in runs)


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


def test_damaged_weights_are_trained_again(run: Run, tiny: Any, planned: Any) -> None:
    first = run("exp1")
    (planned().weights.folder / "offset.json").write_text("1.0")
    again = run("exp1", store="again")
    assert len(tiny.TinyModel.fits) == 2
    assert again.record.identity.weights_hash == first.record.identity.weights_hash


@pytest.mark.parametrize(
    ("behave", "said"),
    [
        ("twice", "gave 2 answers for one frame"),
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


def test_scoring_again_is_identical(
    run: Run, planned: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = run("exp1")
    spec = planned("exp1").protocol.spec
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


def test_a_model_with_maps_and_no_reader_is_told_to_write_one() -> None:
    class Maps(StubModel):
        def maps(self, frames: Any) -> Any:
            return np.zeros((len(frames), 1, 4, 4), np.float32)

    frame = Frame(np.zeros((8, 8), np.uint8), 0.0, Pose(), np.zeros((8, 8), np.uint8))
    rules = AnswerRules("contacts", None, (4, 4))
    with pytest.raises(UserError, match="model Maps gives maps, but has no read_maps"):
        predict_frames(Maps(), [frame], rules, lambda _: None)  # type: ignore[arg-type]


def frames(count):
    return [Frame(np.full((2, 2), k, np.uint8), float(k), Pose(depth=1.0)) for k in range(count)]


def test_frames_are_spread_over_all():
    arrays = example_arrays(frames(100))
    assert len(arrays["index"]) == EXAMPLES
    assert (arrays["images"][:, 0, 0] == arrays["index"]).all()
    assert set(arrays) == {"index", "images"}


def bounds_by_depth(self: Any, scenes: Any) -> np.ndarray:
    """0.01 mm per mm of depth; nothing is known of presses below 5 mm."""
    depth = np.array([scene.pose.depth for scene in scenes])
    return np.where(depth > 5, np.inf, 0.01 * depth)


def terms_by_tips(self: Any, scenes: Any) -> dict[str, int]:
    return {"pair": sum(len(scene.indenter.offsets) == 2 for scene in scenes)}


@pytest.fixture
def knows_its_error(tiny: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiny.TinySensor, "error_bounds", bounds_by_depth)
    monkeypatch.setattr(tiny.TinySensor, "terms", terms_by_tips)


@pytest.mark.usefixtures("knows_its_error", "unscored")
def test_the_record_has_the_error_of_every_test_set(run: Run, planned: Any, tmp_path: Any) -> None:
    done = run("exp2")
    sets = planned("exp2").frames.test
    assert [error.name for error in done.record.data.simulator] == [
        *("pairs", "catch"),
        *("between", "uneven"),
    ]
    for error, frames in zip(done.record.data.simulator, sets, strict=True):
        depth = np.array([scene.pose.depth for scene in frames.scenes])
        known = 0.01 * depth[depth <= 5]
        assert (error.scenes, error.unknown) == (len(depth), (depth > 5).sum())
        assert error.median_mm == pytest.approx(np.median(known), abs=1e-4)
        assert error.p95_mm == pytest.approx(np.quantile(known, 0.95), abs=1e-4)
        assert error.max_mm == pytest.approx(known.max(), abs=1e-4)
        assert error.terms == {"pair": 0 if error.name == "catch" else len(depth)}
    again = open_run(tmp_path / "runs", done.record.name)
    assert again.record.data.simulator == done.record.data.simulator
