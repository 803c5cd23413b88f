"""The ways of a model to compute: compared, raced, chosen, and what the record is told."""

from __future__ import annotations

import json
from typing import Any, ClassVar

import numpy as np
import pytest
from stubs import StubModel

from tactibench import Contacts, Frame, Pose, UserError
from tactibench.run import (
    Configuration,
    Difference,
    LatencySample,
    Load,
    compare_configurations,
    fastest,
    latency,
    metric_rows,
    race,
    race_steps,
    time_model,
    timing,
)
from tactibench.run import configurations as configurations_module

pytestmark = pytest.mark.long

FRAMES = [Frame(np.full((2, 2), value, np.uint8), float(value), Pose()) for value in range(10)]
TRUTH = [Contacts.truth([[0.0, 0.0]], [1.0 + value]) for value in range(10)]


class Ways(StubModel):
    """Reads depth from the gray level, 0.5 mm too deep; ``coarse`` rounds, ``many`` doubles."""

    configurations: ClassVar[dict[str, str]] = {
        "float32": "as it is",
        "exact": "the same",
        "coarse": "rounded",
        "many": "sees double",
        "gone": "not here",
        "compiled": "compiled",
    }

    def parameter_count(self) -> int:
        return 7

    def __init__(self) -> None:
        self.made: list[str] = []

    def predict(self, frames: Any) -> list[Contacts]:
        return [self._answer(frame) for frame in frames]

    def _answer(self, frame: Frame, shift: float = 0.0, count: int = 1) -> Contacts:
        assert frame.timestamp == 0, "blinded"
        depth = float(frame.image[0, 0]) + 1.5 + shift
        return Contacts(np.zeros((count, 2)), np.full(count, depth), np.ones(count))

    def configured(self, name: str, frames: Any) -> Any:
        assert len(frames) == 1
        if name == "gone":
            raise UserError("gone is not here.")
        self.made.append(name)
        shift, count = (0.1 if name == "coarse" else 0.0), (2 if name == "many" else 1)
        return [
            ("forward", lambda given: given),
            ("decode", lambda given: [self._answer(frame, shift, count) for frame in given]),
        ]

    def flops(self, frame: Frame) -> int:
        return frame.image.size


def blinded(frames: list[Frame]) -> list[Frame]:
    return [Frame(frame.image, 0.0, Pose()) for frame in frames]


def test_every_way_is_compared_and_what_fails_is_said() -> None:
    model, seen = Ways(), blinded(FRAMES)
    found = compare_configurations(model, seen, model.predict(seen), TRUTH)
    assert [one.name for one in found.usable] == ["float32", "exact", "coarse", "many"]
    gaps = {one.name: one.difference for one in found.usable}
    assert gaps["exact"] == Difference(0.0, 10, 0, 0.0, largest_mm=0.0)
    assert gaps["coarse"].median_mm == pytest.approx(0.1)
    assert gaps["coarse"].error_change == pytest.approx(0.2)
    assert gaps["many"].other_count == 10
    assert [one.difference.allowed for one in found.usable] == [True, True, False, False]
    assert found.skipped["gone"] == "gone is not here."
    assert "--compile" in found.skipped["compiled"]
    assert "compiled" not in model.made
    compare_configurations(model, seen, model.predict(seen), TRUTH, compiled=True)
    assert "compiled" in model.made


def test_a_model_without_a_choice_is_timed_as_it_is() -> None:
    class Plain(StubModel):
        predict = Ways.predict
        _answer = Ways._answer

    model, seen = Plain(), blinded(FRAMES)
    (only,) = compare_configurations(model, seen, model.predict(seen), TRUTH).usable  # type: ignore[arg-type]
    assert (only.name, only.description) == ("default", "as the model predicts")
    assert only.difference.median_mm == 0
    assert [name for name, _ in only.stages] == ["predict"]
    timed = time_model(model, FRAMES, model.predict(seen), truth=TRUTH)  # type: ignore[arg-type]
    assert timed.timed["raced"] == []
    assert timed.efficiency["parameters"] is None
    assert timed.efficiency["flops_per_frame"] is None
    assert isinstance(timed.efficiency["peak_memory_mb"], float)


def test_a_model_of_which_no_way_works_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Ways, "configurations", {"gone": "not here", "compiled": "compiled"})
    with pytest.raises(UserError, match=r"gone: gone is not here; compiled: .*--compile\.$"):
        compare_configurations(Ways(), blinded(FRAMES), [None] * 10, TRUTH)


def sample(ms: float) -> LatencySample:
    raw = np.array([[ms], [ms], [99.0]])
    return LatencySample(("all",), raw, True, 40, 1, 1, raw, Load())


def test_the_fastest_of_the_allowed_wins() -> None:
    good, bad = Difference(0.0, 10, 0, 0.0), Difference(0.0, 10, 0, 0.03)
    one, two, three = (
        Configuration(name, name, [], gap)
        for name, gap in (("one", good), ("two", good), ("three", bad))
    )
    times = {"one": sample(3.0), "two": sample(2.0), "three": sample(1.0)}
    assert fastest([one, two, three], times) is two
    assert fastest([three], times) is three


def test_a_run_times_the_chosen_way_and_tells_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timing, "all_threads", lambda: 2)
    monkeypatch.setattr(timing, "BATCHES", latency.BATCHES)  # fixtures of this folder time less
    model = Ways()
    speed = time_model(model, FRAMES, model.predict(blinded(FRAMES)), truth=TRUTH)
    assert speed.timed["configuration"] in {"as it is", "the same"}
    assert [one["configuration"] for one in speed.timed["raced"]] == [
        "as it is",
        "the same",
        "rounded",
        "sees double",
    ]
    assert speed.timed["difference_mm"] == 0
    assert speed.timed["error_change"] == 0
    asked = [(row["scenario"], row["batch"], row["threads"]) for row in speed.rows]
    assert list(dict.fromkeys(asked)) == [
        ("single", 1, 1),
        ("single", 1, 2),
        ("offline", 1, 2),
        ("offline", 8, 2),
        ("offline", 32, 2),
        ("offline", 128, 2),
    ]
    timed = (
        "single_1_threads",
        "single_2_threads",
        *(f"offline_{n}_frames" for n in (1, 8, 32, 128)),
    )
    assert set(speed.raw) == {f"{name}_{kind}" for name in timed for kind in ("ms", "cpu_ms")}
    assert speed.efficiency["parameters"] == 7
    assert speed.efficiency["flops_per_frame"] == 4
    json.dumps([speed.rows, speed.timed, speed.efficiency])


def test_a_race_has_every_way_in_every_scenario(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(configurations_module, "all_threads", lambda: 2)
    monkeypatch.setattr(configurations_module, "WAIT_S", 0.05)
    model, told = Ways(), []
    finished = race(model, FRAMES, TRUTH, calls=20, batches=(1, 4), advance=told.append)
    assert len(told) <= race_steps(model, (1, 4)) == 10
    assert finished.best.name in {"float32", "exact"}
    for one in finished.configurations.usable:
        assert finished.total(one.name, 1)["p50_ms"] > 0
        assert finished.total(one.name, 2)["per_s"] > 0
        assert finished.total(one.name, 2, 4, "offline")["batch"] == 4
    assert finished.total("gone", 1) is None
    rows = metric_rows(finished)
    assert all(set(row) == {"metric", "group", "value", "unit"} for row in rows)
    found = {(row["metric"], row["group"]): row for row in rows}
    assert found["difference_mm", "coarse"]["value"] == pytest.approx(0.1)
    assert found["p90_ms", "exact, single, batch 1, 1 thread, decode"]["unit"] == "ms"
    assert found["per_s", "exact, offline, batch 4, 2 threads"]["value"] > 0
    ((best, speedup),) = [(g, row["value"]) for (m, g), row in found.items() if m == "speedup"]
    assert best == finished.best.name
    assert speedup >= 1  # it has the lowest median, and the first is among those allowed
    json.dumps(rows)
