"""Runs that change the sensor: trained on one folder or simulator, tested on another folder."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from briefly import time_briefly
from drawn_pins import SIZE, draw, hexagon

from tactibench import UserError
from tactibench.board import (
    Source,
    section_key,
    submissions,
    trained_on,
    verify,
)
from tactibench.plugins import PluginHost
from tactibench.protocols import protocol_files
from tactibench.records import StoredRun, measured_on, unpack_plates
from tactibench.run import (
    NullReporter,
    RunPlan,
    RunRequest,
    TestOptions,
    execute,
    folder_label,
    make_plan,
    metric_differences,
    read_test_options,
    score_arrays,
)

SHOTS = (0, 5, 20)
GIVEN = {"labels": "given"}
Plan = Callable[..., RunPlan]
Done = Callable[[str], tuple[RunPlan, StoredRun]]


def write(folder: Path, rest: np.ndarray, count: int, seed: int) -> Path:
    """A Bristol folder of plate presses: label = depth - 5 mm, pins flee from the contact."""
    rng = np.random.default_rng(seed)
    lines = ["image_name,pose_1,pose_2,pose_3,pose_4,pose_5,pose_6"]
    (folder / "frames_bw").mkdir(parents=True)
    cv2.imwrite(str(folder / "frames_bw" / "init_0.png"), draw(rest))
    for k in range(count):
        x, depth = rng.uniform(-6, 6), rng.uniform(2, 5)
        away = rest - [2.5 * x + (SIZE - 1) / 2, (SIZE - 1) / 2]
        square = (away**2).sum(axis=1, keepdims=True)
        moved = 0.12 * depth * away * np.exp(-square / (2 * 9.0**2))
        cv2.imwrite(str(folder / "frames_bw" / f"frame_{k}_0.png"), draw(rest + moved))
        lines.append(f"frame_{k}_0.png,0,{depth - 5},0,0,0,{3 * x}")
    (folder / "targets.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    place = tmp_path_factory.mktemp("recordings")
    return (
        write(place / "one", hexagon(3, 8.0), 120, 1),
        write(place / "two", hexagon(4, 6.0), 90, 2),
    )


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of the protocol, the cache and the runs that all tests share."""
    return tmp_path_factory.mktemp("transfer")


@pytest.fixture(scope="module")
def protocol(place: Path) -> str:
    text = protocol_files()["transfer"].read_text(encoding="utf-8")
    text = text.replace("[0, 10, 50, 200]", str(list(SHOTS))).replace("= 4000", "= 40")
    path = place / "few-transfer.toml"
    path.write_text(text.replace('id = "transfer"', 'id = "few-transfer"'), encoding="utf-8")
    return str(path)


@pytest.fixture(scope="module")
def planned(protocol: str, folders: tuple[Path, Path], place: Path) -> Plan:
    def plan(model: str = "kernel", **more: Any) -> RunPlan:
        asked: dict[str, Any] = {
            "data": folders[0],
            "test": TestOptions(parameters=GIVEN, data=folders[1]),
            "parameters": {"sensor": GIVEN},
        }
        request = RunRequest(protocol, model, **asked | more)
        return make_plan(request, PluginHost(), place / "cache", store=place / "runs")

    return plan


@pytest.fixture(scope="module")
def done(planned: Plan, place: Path) -> Done:
    """Model -> its plan and its run on all 18 test frames, carried out once."""

    @cache
    def run_of(model: str) -> tuple[RunPlan, StoredRun]:
        plan = planned(model)
        with pytest.MonkeyPatch.context() as patch:
            time_briefly(patch.setattr)
            return plan, execute(plan, NullReporter())

    return run_of


@pytest.mark.long
def test_every_test_frame_is_answered_for_every_number_of_labelled_frames(
    done: Done, place: Path
) -> None:
    plan, run = done("kernel")
    record, truth = run.record, run.arrays("truth")
    assert list(truth["group"]) == [str(count) for count in SHOTS for _ in range(18)]
    poses = unpack_plates(truth)
    for rows in (list(truth["press"]), list(poses)):
        assert rows == rows[:18] * len(SHOTS)
    rows = {(row.metric, row.group): row for row in record.metrics}
    assert {group for metric, group in rows if metric == "tilt_mae_deg"} == {"0", "5", "20"}
    assert all(row.n == row.clusters == 18 for row in rows.values())
    assert rows["depth_mae_mm", "20"].value < 1.0
    seen = record.data.of_tested_sensor
    assert seen.labelled_frames == list(SHOTS)
    assert seen.unlabelled_frames == 0
    assert [one["frames"] for one in seen.adapted] == list(SHOTS)
    again = score_arrays(plan.protocol.spec, truth, run.arrays("predictions"), {})
    assert not metric_differences(record.metrics, again)
    assert record.sensor.test_sensor.trained_on.startswith("real recording ")
    assert measured_on(record).startswith(f"real recording {folder_label(plan.request.test.data)}")
    assert trained_on(record) in section_key(record)[-1]
    assert str(place.parent) not in str(record.sensor)


def test_no_press_is_both_seen_and_tested(planned: Plan) -> None:
    plan = planned()
    (test,), shots = plan.frames.test, plan.frames.few_shot
    assert shots is not None
    assert len(shots.names) == max(SHOTS)
    assert not set(shots.names) & set(test.names)
    assert len(test.names) == round(0.2 * 90)


def test_two_recordings_of_one_plan_are_divided_alike(
    planned: Plan, folders: tuple[Path, Path]
) -> None:
    """A press of the plan that trains on one sensor tests nothing on the other."""
    plan = planned(test=TestOptions(parameters=GIVEN, data=folders[0]))
    seen = {name for wanted in (*plan.frames.fit, *plan.frames.validation) for name in wanted.names}
    assert not seen & set(plan.frames.test[0].names)


def test_models_that_cannot_adapt_answer_without_labelled_frames(done: Done) -> None:
    _, run = done("mean")
    assert {row.group for row in run.record.metrics} == {"0"}
    assert run.record.data.of_tested_sensor.labelled_frames == [0]


def test_a_simulated_sensor_trains_and_its_calibration_frames_test_nothing(
    planned: Plan, folders: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    from tactibench_sim import FittedSensor

    simulated = {"data": None, "sensor": "fitted-127", "parameters": {"sensor": {"size": "64"}}}
    before = planned(**simulated)
    assert before.frames.sensor_identity["name"] == "fitted-127"
    assert [len(wanted.scenes) for wanted in before.frames.fit] == [36]
    assert [len(wanted.scenes) for wanted in before.frames.validation] == [4]
    assert before.frames.test_identity is not None
    digest = before.frames.test_identity["describe"]["sha256"]
    used = (*before.frames.test[0].names[:3], "no such frame")
    monkeypatch.setattr(FittedSensor, "calibrated_on", lambda _: {digest: used, "other": ("x",)})
    after = planned(**simulated)
    assert set(after.frames.test[0].names) == set(before.frames.test[0].names) - set(used)
    assert after.frames.calibrated == 3
    assert any("3 frames calibrated" in line for line in after.lines())


def test_labels_are_fitted_and_their_direction_must_be_that_of_the_simulated_plates(
    planned: Plan, folders: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The folder's plates tilt towards the right of the frame, simulated ones downwards."""
    monkeypatch.setattr("tactibench.datasets.pivot.MOST_MISFIT", 1.0)
    fitted = TestOptions(parameters={"labels": "fitted"}, data=folders[1])
    plan = planned(test=fitted)
    assert plan.frames.test_identity is not None
    described = plan.frames.test_identity["describe"]
    assert described["label_fit"]["presses"] == 90
    assert abs(described["label_fit"]["lean_deg"]) < 20
    simulated = {"data": None, "sensor": "fitted-127", "parameters": {"sensor": {"size": "64"}}}
    with pytest.raises(UserError, match=r"deg of the frame .* but simulated plates towards 90"):
        planned(**simulated, test=fitted)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"test": TestOptions()}, "--test data=FOLDER"),
        ({"test": TestOptions(reference=True, data=Path())}, "--test reference out"),
        ({"test": TestOptions(hidden=True, data=Path())}, "--hidden-seed out"),
        ({"test": TestOptions(data=Path("nowhere"))}, "check --test data=FOLDER"),
        ({"data": None}, "--data DIR"),
        ({"data": None, "sensor": "tactip-127"}, "no parameter 'labels'"),
    ],
)
def test_what_cannot_be_is_said(planned: Plan, more: dict[str, Any], said: str) -> None:
    with pytest.raises(UserError, match=said):
        planned(**more)


def test_too_few_presses_for_the_shots_are_refused(planned: Plan, tmp_path: Path) -> None:
    small = write(tmp_path / "small", hexagon(3, 8.0), 20, 3)
    with pytest.raises(UserError, match="up to 20 labelled"):
        planned(test=TestOptions(parameters=GIVEN, data=small))


def test_the_option_is_read() -> None:
    found = read_test_options(("data=a/b", "sensor.pivot_mm=3"))
    assert (found.data, found.parameters) == (Path("a/b"), {"pivot_mm": "3"})
    assert found.texts == ["data=" + folder_label(Path("a/b")), "sensor.pivot_mm=3"]
    with pytest.raises(UserError, match="twice"):
        read_test_options(("data=a", "data=b"))
    with pytest.raises(UserError, match="data=FOLDER"):
        read_test_options(("data=",))


@pytest.fixture
def submitted(
    done: Done, protocol: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[str], Path]:
    """Model -> its submission, on all test frames; the path of its record."""
    monkeypatch.setenv("TACTIBENCH_PROTOCOLS", str(Path(protocol).parent))

    def made(model: str) -> Path:
        return submissions.add(done(model)[1], tmp_path / "boards")[0]

    return made


@pytest.mark.parametrize("model", [pytest.param("kernel", marks=pytest.mark.long), "mean"])
def test_a_submission_is_scored_again_on_the_recording_that_was_tested(
    submitted: Callable[[str], Path], folders: tuple[Path, Path], tmp_path: Path, model: str
) -> None:
    path = submitted(model)
    found = verify(path, Source(PluginHost(), tmp_path / "cache", folders[1]))
    assert found.frames == 18
    groups = {row.group for row in found.again}
    assert groups == ({"0"} if model == "mean" else {"0", "5", "20"})
