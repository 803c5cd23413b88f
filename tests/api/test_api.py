"""tactibench.api: the same results as the command line, as objects and frames."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stored_answers import answered_parts, store_run

from tactibench import UserError, api
from tactibench.records import Record, StoredRun, open_run
from tactibench.report import Table
from tactibench.run import NullReporter, train_model

QUICK = {"quick": True, "limit": 3, "progress": False}


@pytest.fixture
def store(tmp_path: Path, fabricate: Callable[..., Record]) -> Path:
    """Two runs of exp1 whose errors are 0.05 and 0.10 mm along x, and one of exp2."""
    folder = tmp_path / "runs"
    store_run(folder, fabricate(model="cnn"), answered_parts(0.05))
    store_run(folder, fabricate(model="unet"), answered_parts(0.10))
    store_run(folder, fabricate("exp2", model="unet"))
    return folder


def run_of(store: Path, model: str, protocol: str = "exp1") -> StoredRun:
    (name,) = {
        name for name in api.load_runs(store, protocol=protocol)["run"] if f"-{model}-" in name
    }
    return api.load_run(name, store)


@pytest.mark.long
def test_a_run_with_three_presses_is_stored_and_found_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path / "cache"))
    store = tmp_path / "runs"
    plan = api.plan("exp1", "mean", quick=True, limit=3, store=store)
    assert not plan.stored
    assert plan.lines()[0] == f"plan: {plan.name}"
    done = api.run("exp1", "mean", store=store, **QUICK)
    assert done.name == plan.name
    assert plan.stored
    assert "is in the store" in plan.lines()[0]
    assert done.record.partial
    assert done.value("missed") == done.record.value("missed", "all")
    assert api.run("exp1", "mean", store=store, **QUICK).record == done.record
    # The mean answers one place for all presses: R2 has a value, and no interval that holds it.
    r2 = done.metrics.query("metric == 'r2' and group == 'mean'").iloc[0]
    assert r2["value"] < 0
    assert r2[["low", "high"]].isna().all()
    _, weights = train_model(plan, NullReporter())
    assert weights.reused


def test_parameters_are_given_as_a_mapping_or_as_texts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tactibench.run.make_plan", lambda request, *_, **__: request)
    one: Any = api.plan("exp1", "unet", params={"model.width": 8, "sensor.instance": 1})
    other: Any = api.plan("exp1", "unet", params=["model.width=8", "sensor.instance=1"])
    assert one == other
    assert one.parameters == {"model": {"width": "8"}, "sensor": {"instance": "1"}}
    with pytest.raises(UserError, match="not understood"):
        api.plan("exp1", "unet", params={"width": 8})


def test_frames_hold_what_the_records_hold(store: Path) -> None:
    frame = api.load_runs(store)
    assert set(frame["protocol"]) == {"exp1", "exp2"}
    assert set(api.load_runs(store, protocol="exp2")["protocol"]) == {"exp2"}
    run = run_of(store, "cnn")
    own = frame[frame["run"] == run.name]
    assert len(own) == len(run.record.metrics) == len(run.metrics)
    (missed,) = own[own["metric"] == "missed"]["value"]
    assert missed == run.value("missed") == 0.01
    assert set(run.speed["phase"]) == {"total"}
    assert api.load_runs(store / "none").empty


def test_an_unknown_metric_is_named_with_the_close_one(store: Path) -> None:
    run = run_of(store, "cnn")
    with pytest.raises(UserError, match="has no metric 'gospa'; did you mean 'gospa_depth_mm'"):
        run.value("gospa")
    with pytest.raises(UserError, match=r"has no gospa_depth_mm of 'mean'; it has those of .*all"):
        run.value("gospa_depth_mm", "mean")


def test_runs_are_compared_by_name_or_as_they_are(store: Path) -> None:
    cnn, unet = run_of(store, "cnn"), run_of(store, "unet")
    compared = api.compare(cnn, unet)
    mae = compared.frame.set_index("metric").loc["mae_mm"]
    assert mae["value"] == pytest.approx((0.05 - 0.10) / 3)
    assert api.compare(cnn.name, unet.name, store=store).rows == compared.rows
    with pytest.raises(UserError, match="name two or more"):
        api.compare(cnn)


def test_scoring_again_says_what_differs(store: Path) -> None:
    scored = api.score(run_of(store, "cnn"))
    assert scored.run.value("mae_mm", "mean") == pytest.approx(0.05 / 3)
    assert any(line.startswith("mae_mm of mean: stored") for line in scored.differences)
    assert not scored.completed


def test_a_board_is_a_frame_and_places_a_run(
    store: Path, tmp_path: Path, fabricate: Callable[..., Record]
) -> None:
    from tactibench.board import add

    board = tmp_path / "board"
    board.mkdir()
    unet = run_of(store, "unet")
    assert api.place(unet, board) is None
    add(unet, board)
    cnn = run_of(store, "cnn")
    first = api.place(cnn, board)
    assert first is not None
    # One seed of six presses is no rank; the row above is named all the same.
    assert (first.rows, first.rank) == (0, None)
    add(cnn, board)
    frame = api.load_board("exp1", board)
    assert set(frame["model"]) == {"cnn", "unet"}
    with pytest.raises(UserError, match="there is no folder"):
        api.load_board("exp1", tmp_path / "nowhere")


def test_a_figure_has_its_numbers(store: Path, tmp_path: Path) -> None:
    board = tmp_path / "board"
    board.mkdir()
    made = api.plot("frontier", "exp1", board=board, store=store)
    assert set(made.frame["metric"]) == {"p90_ms", "gospa_depth_mm"}
    assert all(isinstance(one, Table) for one in made.data.tables)
    assert made.save(tmp_path / "a.png").stat().st_size > 1000
    with pytest.raises(UserError, match=r"a.gif is no PNG file; call it .*a.png"):
        made.save(tmp_path / "a.gif")
    with pytest.raises(UserError, match="did you mean 'frontier'"):
        api.plot("fronteer", "exp1", board=board, store=store)


@pytest.mark.long
def test_the_limits_of_a_sensor_have_their_numbers(tmp_path: Path) -> None:
    options: dict[str, Any] = {"reach": 0, "depths": [2], "progress": False}
    made = api.plot_limit(**options)
    middle = made.frame.set_index("group").query("metric == 'bound_x_mm'")["value"]
    assert 1e-4 < middle["depth 2 mm, middle"] < 0.02
    noisy = api.plot_limit(params={"read_noise": 12}, **options).frame
    assert noisy["value"].iloc[0] > 2 * made.frame["value"].iloc[0]
    assert made.save(tmp_path / "limit.png").stat().st_size > 1000
    with pytest.raises(UserError, match="does not know what limits"):
        api.plot_limit("recorded", **options)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"scene": "triple"}, "'single' or 'dual'"),
        ({"scene": "dual", "spacing": 0.0}, "spacing 0 mm is not above 0"),
    ],
)
def test_limits_of_no_possible_press_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(UserError, match=words):
        api.plot_limit(**{"progress": False, **options})


def test_answers_that_could_not_be_scored_are_scored_by_name(
    tmp_path: Path, fabricate: Callable[..., Record]
) -> None:
    from changed_record import changed_record

    from tactibench.records import arrays_hash, write_answers

    parts = answered_parts(0.05)
    record = changed_record(
        fabricate(), {"identity.predictions_hash": arrays_hash(parts["predictions"]), "metrics": []}
    )
    write_answers(tmp_path, record, parts)
    with pytest.raises(UserError, match="there is no run"):
        open_run(tmp_path, record.name)
    scored = api.score(record.name, tmp_path)
    assert scored.completed
    assert open_run(tmp_path, record.name).record == scored.run.record
    assert scored.run.value("mae_mm", "mean") == pytest.approx(0.05 / 3)


def test_contacts_are_rendered_and_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path / "cache"))
    frame = api.render([[0.0, 0.0, 2.0], [7.0, 1.0, 3.0]], params={"size": 64})
    assert frame.image.shape == (64, 64)
    assert frame.rest_image is not None
    assert not np.array_equal(frame.image, frame.rest_image)
    again, other = (
        api.render([[0.0, 0.0, 2.0], [7.0, 1.0, 3.0]], params={"size": 64}, seed=seed)
        for seed in (0, 1)
    )
    assert np.array_equal(frame.image, again.image)
    assert not np.array_equal(frame.image, other.image)
    for contacts, said in (
        ([1.0, 2.0], "rows of x, y and depth"),
        ([], "rows of x, y and depth"),
        ([[25.0, 0.0, 1.0], [0.0, 0.0, 1.0]], "x 25, y 0 mm lies beside the dome"),
    ):
        with pytest.raises(UserError, match=said):
            api.render(contacts)
    with pytest.raises(UserError, match=r"run exp1 --model nearest --train-only"):
        api.load_model("nearest")


@pytest.mark.long
def test_a_trained_model_answers_a_frame(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path / "cache"))
    small = {"sensor.size": 64}
    train_model(api.plan("exp1", "nearest", params=small), NullReporter())
    model = api.load_model("nearest", params=small)
    assert repr(model) == "TrainedModel(nearest)"
    frame = api.render([[2.0, -1.0, 3.0]], params={"size": 64})
    answer = model.predict(frame)
    assert np.hypot(*(answer.xy[0] - [2.0, -1.0])) < 2.0
    alone = model.predict(frame.image, rest=frame.rest_image)
    assert alone.xy == pytest.approx(answer.xy)


def test_what_is_shown_of_a_plan_or_run_is_its_name(store: Path) -> None:
    assert repr(run_of(store, "cnn")).startswith("StoredRun(exp1-cnn-")
    assert repr(api.plan("exp1", "mean")).startswith("RunPlan(exp1-mean-single-s0-")
