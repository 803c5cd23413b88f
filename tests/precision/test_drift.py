"""``tactibench speed MODEL --precision``: drift is measured, what is not finite is counted."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stubs import StubModel

from tactibench import Contacts, Frame, PlatePose, Pose, UserError
from tactibench.cli.main import call
from tactibench.report.drift_report import cells, length, share, verdict, worst
from tactibench.run import arithmetic, drift
from tactibench.run.arithmetic import ways
from tactibench.run.difference import Difference, compare
from tactibench.run.drift import Drift, Drifts, read_all, run_drift
from tactibench.training import LearnedModel

FRAMES = [Frame(np.full((2, 2), k, np.uint8), 0.0, Pose()) for k in range(8)]
TRUTH = [Contacts.truth([[float(k), 0.5]], [2.0]) for k in range(8)]


class Shifted(StubModel):
    """Exact in float32; each way shifts x, and "bad" gives one output that is no number."""

    configurations = {"float32": "as it is", "shifted": "by 0.01 mm", "bad": "NaN", "absent": "-"}  # noqa: RUF012

    def predict(self, frames: Any) -> list[Contacts]:
        return self._answers(self._outputs(frames))

    def configured(self, name: str, frames: Any) -> list[tuple[str, Any]]:
        if name == "absent":
            raise UserError("this machine has no such way.")
        change = {"float32": 0.0, "shifted": 0.01, "bad": 0.0}[name]

        def forward(seen: Any) -> Any:
            values = self._outputs(seen) + np.array([change, 0.0, 0.0])
            if name == "bad":
                values[values[:, 0] == 3.0] = np.nan
            return values

        return [("forward", forward), ("decode", self._answers)]

    def _outputs(self, frames: Any) -> Any:
        return np.array([[float(frame.image[0, 0]), 0.0, 2.0] for frame in frames])

    def _answers(self, outputs: Any) -> list[Contacts]:
        return [Contacts(row[None, :2], row[2:], np.ones(1)) for row in outputs]


def test_drift_is_measured_in_mm_and_as_a_share_of_the_error() -> None:
    found = run_drift(Shifted(), FRAMES, TRUTH, batches=(1, 4, 100), threads=(1, 2))  # type: ignore[arg-type]
    assert found.error_mm == pytest.approx(0.5)
    rows = {(r.configuration, r.batch, r.threads): r for r in found.rows}
    assert set(rows) == {
        (n, b, t) for n in ("float32", "shifted", "bad") for b in (1, 4) for t in (1, 2)
    }
    for row in found.rows:
        if row.configuration == "float32":
            assert (row.apart.median_mm, row.apart.largest_mm, row.share) == (0.0, 0.0, 0.0)
        if row.configuration == "shifted":
            assert row.apart.median_mm == pytest.approx(0.01)
            assert row.share == pytest.approx(0.02)
    assert found.skipped["absent"] == "this machine has no such way."
    assert "no network" in found.skipped["float64"]


def test_outputs_that_are_no_number_are_counted_and_not_averaged() -> None:
    found = run_drift(Shifted(), FRAMES, TRUTH, batches=(1, 4), threads=(1,))  # type: ignore[arg-type]
    one, four = (row for row in found.rows if row.configuration == "bad")
    assert (one.not_finite, one.outputs, one.refused) == (3, 24, 1)
    assert (four.not_finite, four.outputs, four.refused) == (3, 24, 4), "a batch is refused whole"
    assert one.apart.other_count == 1
    assert one.apart.median_mm == 0.0
    assert "not finite" in one.reason
    assert verdict(found).startswith("6 OUTPUTS ARE NOT FINITE")


def test_a_plate_pose_that_is_no_number_is_counted() -> None:
    stages = [("predict", lambda seen: [PlatePose(float("nan"), 0.0) for _ in seen])]
    assert read_all(stages, FRAMES, 3).not_finite == 8


def test_the_largest_distance_stands_beside_the_median() -> None:
    moved = [
        Contacts.truth(one.xy + np.array([k, 0.0]), one.depth) for k, one in enumerate(TRUTH[:3])
    ]
    gap = compare(moved, TRUTH[:3])
    assert (gap.median_mm, gap.largest_mm) == (1.0, 2.0)
    assert compare([], []).largest_mm is None
    assert "largest_mm" not in gap.as_row(), "records hold what they held"


def row(name: str = "bf16", batch: int = 1, threads: int = 1, median: float = 0.03) -> Drift:
    gap = Difference(median, 4, 0, 0.001, 2 * median)
    return Drift(name, "words", batch, threads, gap, median / 0.5, 0, 12, 0)


def test_settings_that_differ_in_threads_alone_share_a_line() -> None:
    lines = cells([row(), row(batch=8), row(threads=2), row(batch=8, threads=2, median=0.01)])
    assert [line[:4] for line in lines] == [
        ("bf16", "1", "1, 2", "0.03000"),
        ("bf16", "8", "1", "0.03000"),
        ("bf16", "8", "2", "0.01000"),
    ]


def test_the_verdict_names_what_drifts_by_more_than_the_aim() -> None:
    rows = (row("fp16", median=0.001), row(median=0.02), row(batch=8))
    assert [one.batch for one in worst(rows)] == [1, 8]
    text = verdict(Drifts(rows, 0.5, {}))
    assert text == "every output is finite; median drift above 2% of the model's error: bf16 (6 %)"
    assert "no median drift above 2%" in verdict(Drifts(rows[:1], 0.5, {}))
    assert "no share of it is known" in verdict(Drifts(rows, None, {}))


def test_lengths_and_shares_as_text() -> None:
    texts = [length(value) for value in (None, 0.0, 3e-7, 0.0127)]
    assert texts == ["n/a", "0.00000", "3.0e-07", "0.01270"]
    assert (share(None), share(0.2269)) == ("n/a", "23 %")


def test_a_way_that_takes_long_to_compile_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    class Slow(Shifted):
        configurations = {"compiled": "torch.compile"}  # noqa: RUF012

        def configured(self, name: str, frames: Any) -> list[tuple[str, Any]]:
            return super().configured("float32", frames)

    monkeypatch.setattr(drift, "COMPILE_S", -1.0)
    found = run_drift(Slow(), FRAMES, TRUTH, batches=(1,), threads=(1,), compiled=True)  # type: ignore[arg-type]
    assert not found.rows
    assert "more than the -1 s that are waited for" in found.skipped["compiled"]
    found = run_drift(Slow(), FRAMES, TRUTH, batches=(1,), threads=(1,))  # type: ignore[arg-type]
    assert found.skipped["compiled"] == "it takes long to make; add --compile"


class Own(LearnedModel):
    """Its own bf16, where the machine has it; nothing else of it is asked."""

    name, native = "own", True
    answers = build = inputs = loss = targets = None  # type: ignore[assignment]

    configurations = {"bf16": "its own bf16"}  # noqa: RUF012

    def configured(self, name: str, frames: Any) -> list[tuple[str, Any]]:
        if not self.native:
            raise UserError("not on this machine.")
        return [("own", list)]


def test_a_way_of_the_model_goes_before_the_type_of_its_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where it cannot be gone the type stands in: what it does can be asked anywhere."""
    model: Any = object.__new__(Own)
    monkeypatch.setattr(arithmetic, "typed_stages", lambda _, name: [(f"any {name}", list)])
    found, skipped = ways(model)
    assert list(found) == ["bf16", "float64", "fp16"]
    assert not skipped
    words, make = found["bf16"]
    assert words == "its own bf16"
    assert [name for name, _ in make(FRAMES[:1])] == ["own"]
    model.native = False
    assert [name for name, _ in make(FRAMES[:1])] == ["any bf16"]
    assert [name for name, _ in found["fp16"][1](FRAMES[:1])] == ["any fp16"]


def test_the_verb_on_a_network_that_ships(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Random weights say as much about rounding; float64 is nearer to float32 than 16 bits are."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(drift, "FEW", 2)
    code = call(
        [
            "speed",
            "cnn",
            "--untrained",
            "--precision",
            "--frames",
            "3",
            "--device",
            "cpu",
            "--param",
            "model.size=64",
            "--param",
            "model.width=8",
            "--json",
            "drift.json",
        ]
    )
    printed = capsys.readouterr()
    assert (code, printed.err) == (0, "")
    assert "RANDOM WEIGHTS" in printed.out
    found = json.loads(Path("drift.json").read_text(encoding="utf-8"))
    largest: dict[str, float] = {}
    for one in found["drift"]:
        name = one["configuration"]
        largest[name] = max(largest.get(name, 0.0), one["largest_mm"])
        assert (one["not_finite"], one["refused"], one["batch"]) == (0, 0, 1)
    assert largest["float64"] < 1e-4 < largest["bf16"]
    assert largest["fp16"] < largest["bf16"]
    assert {"compiled", "float32"} & set(found["skipped"]) == {"compiled"}
    assert all(r.keys() == {"metric", "group", "value", "unit"} for r in found["metrics"])
