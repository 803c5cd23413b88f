"""``benchmarks/precision.py``: drift is measured, what is not finite is counted."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
import pytest
from stubs import StubModel

from tactibench import Contacts, Frame, PlatePose, Pose, UserError

pytestmark = pytest.mark.long

FRAMES = [Frame(np.full((2, 2), k, np.uint8), 0.0, Pose()) for k in range(8)]
TRUTH = [Contacts.truth([[float(k), 0.5]], [2.0]) for k in range(8)]


@pytest.fixture(scope="module")
def precision(load_benchmark: Callable[[str], ModuleType]) -> ModuleType:
    return load_benchmark("precision")


class Shifted(StubModel):
    """Exact in float32; each way shifts x, and "bad" gives one output that is no number."""

    configurations: ClassVar[dict[str, str]] = {
        "float32": "as it is",
        "shifted": "by 0.01 mm",
        "bad": "NaN",
        "absent": "-",
    }

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


def test_drift_is_measured_in_mm_and_as_a_share_of_the_error(precision: Any) -> None:
    found = precision.drift_rows(Shifted(), FRAMES, TRUTH, batches=(1, 4, 100), threads=(1, 2))
    assert found["error_mm"] == pytest.approx(0.5)
    assert found["skipped"] == {"absent": "this machine has no such way."}
    rows = {(r["configuration"], r["batch"], r["threads"]): r for r in found["drift"]}
    names = ("float32", "shifted", "bad")
    assert set(rows) == {(n, b, t) for n in names for b in (1, 4) for t in (1, 2)}
    for (name, batch, _), row in rows.items():
        moved = 0.01 if name == "shifted" else 0.0
        assert row["median_mm"] == pytest.approx(moved)
        assert row["share"] == pytest.approx(moved / 0.5)
        bad = name == "bad"
        assert (row["not_finite"], row["outputs"]) == (3 if bad else 0, 24)
        assert row["refused"] == (batch if bad else 0), "a batch is refused whole"


def test_a_plate_pose_that_is_no_number_is_counted(precision: Any) -> None:
    stages = [("predict", lambda seen: [PlatePose(float("nan"), 0.0) for _ in seen])]
    assert precision.read_all(stages, FRAMES, 3)["not_finite"] == 8


def test_types_of_number_of_a_network_that_ships(
    precision: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Any
) -> None:
    """Random weights say as much about rounding; float64 is nearer to float32 than 16 bits are."""
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(precision, "BATCHES", (1,))
    monkeypatch.setattr(precision, "FEW", 2)
    params = ("model.size=64", "model.width=8")
    found = precision.model_rows("cnn", 3, untrained=True, params=params)
    largest: dict[str, float] = {}
    for row in found["drift"]:
        name = row["configuration"]
        largest[name] = max(largest.get(name, 0.0), row["largest_mm"])
        assert (row["not_finite"], row["refused"]) == (0, 0)
    assert largest["float64"] < 1e-4 < largest["bf16"]
    assert largest["fp16"] < largest["bf16"]
    assert [line[0] for line in precision.model_lines(found)] == ["cnn"] * len(largest)


def test_lengths_and_shares_as_text(precision: Any) -> None:
    texts = [precision.length(value) for value in (None, 0.0, 3e-7, 0.0127)]
    assert texts == ["n/a", "0.00000", "3.0e-07", "0.01270"]
    assert (precision.share(None), precision.share(0.2269)) == ("n/a", "23 %")
