"""``tactibench speed`` on models that ship."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tactibench.run import configurations

pytestmark = pytest.mark.long


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """One round of each scenario, one thread."""
    monkeypatch.setattr(configurations, "WAIT_S", 0.0)
    monkeypatch.setattr(configurations, "BATCHES", (1, 4))
    monkeypatch.setattr(configurations, "all_threads", lambda: 1)


def test_random_weights_are_timed_and_said_to_be(short: Any, cli: Any, tmp_path: Path) -> None:
    code, out, err = cli(
        "speed cnn --untrained --frames 3 --calls 10 --device cpu --json speed.json"
    )
    assert (code, err) == (0, "")
    assert out.startswith("cnn on cpu, 3 test frames of exp1; ")
    assert "RANDOM WEIGHTS" in out
    for name in ("float32", "folded"):
        assert any(line.startswith(name) for line in out.splitlines())
    assert "left out: compiled: it takes long to make; add --compile" in " ".join(out.split())
    default = out.rpartition("default here: ")[2]
    found = json.loads((tmp_path / "speed.json").read_text(encoding="utf-8"))
    assert default.startswith(found["default"])
    assert found["untrained"] is True
    assert {row["scenario"] for row in found["speed"]} == {"single", "offline"}
    assert {row["batch"] for row in found["speed"]} == {1, 4}
    assert {row["phase"] for row in found["speed"]} == {"preprocess", "forward", "decode", "total"}
    by_name = {one["name"]: one for one in found["configurations"]}
    assert by_name["folded"]["difference_mm"] < 1e-3
    assert all(row.keys() == {"metric", "group", "value", "unit"} for row in found["metrics"])


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (("unet", "--protocol", "exp2"), "tactibench run exp2 --model unet --train-only"),
        (("unet", "--train", "--untrained"), "exclude each other"),
        (("mean", "--untrained"), "no random weights"),
        (("unte",), "did you mean 'unet'?"),
        (("unet", "--regime", "several"), "no regime 'several'"),
        (("unet", "--calls", "1"), "10"),
    ],
)
def test_a_mistake_gets_one_sentence(refused: Any, options: tuple[str, ...], named: str) -> None:
    assert named in refused("speed", *options)
