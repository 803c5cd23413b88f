"""Hard cases through a whole run in miniature: frames, failures, score, board and verification."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stubs import StubModel

from tactibench import Contacts, Frame, Pose, UserError
from tactibench.board import check_answers
from tactibench.frames import FAULTS, FramePlan
from tactibench.protocols import protocol_files, read_protocol
from tactibench.records import pack
from tactibench.run import (
    AnswerRules,
    RunPlan,
    TestOptions,
    metric_differences,
    predict_frames,
    predict_or_fail,
    score_arrays,
)

SHORT = {
    "count = 5000": "count = 60",
    "count = 1000": "count = 20",
    "test = 1000": "test = 20",
    "validation = 400": "validation = 10",
    "presses = 50": "presses = 3",
    "presses = 1000": "presses = 4",
    'press = "tip-radius"': 'press = "tip-radius"\nsensor = { offset = "1.0" }',
    'sensor = { friction = "0.5" }': 'sensor = { offset = "1.0" }',
    'parameter = "instance"': 'parameter = "offset"',
    "values = [2, 3, 4, 5, 6]": "values = [2, 3]",  # the tiny sensor shows three tips
    "values = [0.32, 0.45, 0.6, 0.7, 0.8]": "values = [0.2, 0.3]",  # and 7 mm
}


@pytest.fixture
def hard(tmp_path: Path, host: Any) -> str:
    """The protocol with few presses, for a sensor whose one parameter is an offset."""
    text = protocol_files()["stability"].read_text(encoding="utf-8")
    for long, short in SHORT.items():
        assert long in text
        text = re.sub(rf"^{re.escape(long)}", short, text, flags=re.MULTILINE)
    path = tmp_path / "hard.toml"
    path.write_text(text.replace('id = "stability"', 'id = "hard"'), encoding="utf-8")
    return str(path)


@pytest.fixture
def no_pixels(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tiny frames hold numbers, not pictures: a fault adds its amount to the depths."""

    def worse(image: Any, amount: float, rng: np.random.Generator) -> Any:
        out = image.copy()
        if out[0, 3]:
            out[0, 2] = min(255, round(out[0, 2] + amount + rng.uniform(0, 1e-6)))
        return out

    for name in FAULTS:
        monkeypatch.setitem(FAULTS, name, worse)  # type: ignore[arg-type]


def opened(plan: FramePlan) -> dict[str, Any]:
    """Group -> frames."""
    found: dict[str, list[Any]] = {}
    for wanted in plan.test:
        presses = wanted.open(lambda _: None)
        for group, frame in zip(wanted.groups, presses.frames, strict=True):
            found.setdefault(group, []).append(frame)
    return found


def test_every_case_has_its_frames_and_presses_are_shared(
    planned: Callable[..., RunPlan], hard: str
) -> None:
    frames = planned(hard).frames
    spec = read_protocol(Path(hard)).spec
    groups = [group for wanted in frames.test for group in wanted.groups]
    expected = {g for axis in spec.axes for g in (*axis.groups, axis.reference) if g}
    expected |= {"untouched:dim", "untouched:glare", "untouched:blur", "untouched:shift"}
    assert set(groups) == expected
    assert groups.count("grazing:0.05") == 3
    assert groups.count("empty:0") == 4
    by_group = {}
    for wanted in frames.test:
        for group, press in zip(wanted.groups, wanted.clusters, strict=True):
            by_group.setdefault(group, []).append(press)
    assert by_group["grazing:0.5"] == by_group["grazing:2"] == [f"grazing-{k}" for k in range(3)]
    assert by_group["blur:1"] == by_group["individual:2"] == by_group["plain:0"]
    assert len(set(frames.test[0].names)) == 4


def test_faults_are_done_to_the_plain_frames_and_rest_stays(
    planned: Callable[..., RunPlan], hard: str, no_pixels: None
) -> None:
    plan = planned(hard)
    found = opened(plan.frames)
    for plain, worse in zip(found["plain:0"], found["noise:8"], strict=True):
        assert worse.image[0, 2] == plain.image[0, 2] + 8
        assert worse.pose == plain.pose
        assert worse.rest is plain.rest or np.array_equal(worse.rest, plain.rest)
        assert not worse.image.flags.writeable
    again = opened(planned(hard).frames)
    for group, frames in found.items():
        for one, other in zip(frames, again[group], strict=True):
            assert np.array_equal(one.image, other.image)


def test_every_empty_frame_is_tested_again_under_one_fault(
    planned: Callable[..., RunPlan], hard: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[tuple[str, float]] = []
    for name in FAULTS:
        monkeypatch.setitem(
            FAULTS,
            name,
            lambda image, amount, _, name=name: done.append((name, amount)) or image,  # type: ignore[func-returns-value]
        )
    text = Path(hard).read_text(encoding="utf-8").replace("presses = 4", "presses = 13")
    Path(hard).write_text(text, encoding="utf-8")
    plan = planned(hard)
    sets = [one for one in plan.frames.test if one.name.startswith("untouched:")]
    assert [one.name.partition(":")[2] for one in sets] == [
        *("blur", "noise", "dim", "glare", "lost-pins", "shift")
    ]
    pressed = sorted(press for one in sets for press in one.clusters)
    assert pressed == sorted(f"empty-{k}" for k in range(13))
    assert all(
        len(true) == 0 for one in sets for true in one.open(lambda _: None).truth("contacts", 20.0)
    )
    first = [("blur", 0.5), ("blur", 1.0), ("noise", 4), ("noise", 8), ("gain", 0.7), ("gain", 0.5)]
    first += [("gain", 0.35), ("glare", 2), ("glare", 4), ("lost-pins", 0.01), ("lost-pins", 0.03)]
    assert done == [*first, ("shift", 0.25), ("shift", 0.5)]


def test_a_sensor_family_changes_the_sensor_and_nothing_else(
    planned: Callable[..., RunPlan], hard: str
) -> None:
    found = opened(planned(hard).frames)
    for plain, changed in zip(found["plain:0"], found["individual:4"], strict=True):
        assert changed.pose == plain.pose
        assert abs(int(changed.image[0, 0]) - int(plain.image[0, 0]) - 4) <= 1


def test_a_sensor_without_the_parameter_is_refused_in_a_sentence(
    planned: Callable[..., RunPlan], hard: str
) -> None:
    with pytest.raises(
        UserError,
        match=r"family 'sharp' of protocol 'hard' changes the "
        r"sensor: 'other' has no parameter 'offset'",
    ):
        planned(hard, sensor="other")


def test_recorded_folders_and_reference_scenes_are_refused(
    planned: Callable[..., RunPlan], hard: str, tmp_path: Path
) -> None:
    with pytest.raises(UserError, match="presses hard cases, which the folder of sensor"):
        planned(hard, sensor="recorded", data=tmp_path)
    with pytest.raises(UserError, match="leave --test reference out"):
        planned(hard, test=TestOptions(reference=True))


def test_a_run_counts_failures_names_them_and_scores_again(
    run: Callable[..., Any], hard: str, no_pixels: None, tiny: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = tiny.TinyModel.predict

    def fragile(self: Any, frames: Any) -> Any:
        if frames[0].image[0, 3] == 3:
            raise IndexError("no room for three")
        return asked(self, frames)

    monkeypatch.setattr(tiny.TinyModel, "predict", fragile)
    stored = run(hard)
    record = stored.record
    rows = {(row.metric, row.group): row for row in record.metrics}
    spec = read_protocol(Path(hard)).spec
    assert rows["raised", "many"].value == rows["raised", "all"].value
    assert rows["not_finite", "all"].value == 0
    failed = stored.arrays("predictions")
    groups = stored.arrays("truth")["group"]
    assert set(groups[failed["failed"]]) == {"many:3"}
    assert record.data.failures.json_values() == {
        "frames": 3,
        "causes": [{"cause": "IndexError: no room for three", "first": "many:3", "frames": 3}],
    }
    assert record.speed == []
    assert record.partial is False
    again = score_arrays(spec, stored.arrays("truth"), failed, stored.arrays("maps"))
    assert metric_differences(record.metrics, again) == []
    assert rows["ospa_mm", "noise:64"].value > rows["ospa_mm", "plain:0"].value
    images = stored.arrays("examples")
    assert len(images["index"]) == len(set(groups))  # one of every case


FRAMES = [Frame(np.full((4, 4), k, np.uint8), 0.0, Pose()) for k in range(6)]
SHAPE = (4, 4)


class Fragile(StubModel):
    """Fails on frames 1 (raises), 2 (NaN), 3 (too many) and answers the others."""

    def predict(self, frames: Any) -> list[Any]:
        number = int(frames[0].image[0, 0])
        if number == 1:
            raise IndexError("index 127 is out\nof bounds \x1b[31m")
        if number == 2:
            return [Contacts(np.array([[np.nan, 0.0]]), np.ones(1), np.ones(1))]
        count = 3 if number == 3 else 1
        return [Contacts(np.zeros((count, 2)), np.ones(count), np.ones(count))]


RULES = AnswerRules("contacts", 2, SHAPE)


def ask(model: Any) -> tuple[list[Any], dict[str, Any]]:
    done: list[int] = []
    answers, failures = predict_or_fail(model, FRAMES, RULES, done.append)
    assert sum(done) == len(FRAMES)
    return answers, failures


def test_failures_are_told_apart_and_named() -> None:
    answers, failures = ask(Fragile())
    assert [len(answer) for answer in answers] == [1, 0, 0, 0, 1, 1]
    assert failures["failed"].tolist() == [1, 2, 3]
    assert failures["raised"].tolist() == [True, False, True]
    raised, not_finite, too_many = failures["cause"]
    assert raised == "IndexError: index 127 is out of bounds [31m"
    assert "xy holds a value that is not finite" in not_finite
    assert "declares at most 2 contacts" in too_many


def test_other_protocols_stop_loudly() -> None:
    with pytest.raises(IndexError, match="out"):
        predict_frames(Fragile(), FRAMES, RULES, lambda _: None)  # type: ignore[arg-type]


def test_an_interruption_is_no_failure_of_the_model() -> None:
    class Stopped(Fragile):
        def predict(self, frames: Any) -> list[Any]:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ask(Stopped())


def submitted(**more: Any) -> dict[str, Any]:
    answers, failures = ask(Fragile())
    return {**pack(answers, "contacts"), **failures, **more}


def test_answers_with_failures_are_checked() -> None:
    check_answers(submitted(), "contacts", 6, "a.npz", guarded=True)
    with pytest.raises(UserError, match="nothing besides"):
        check_answers(submitted(), "contacts", 6, "a.npz")
