"""``tactibench speed`` on models that ship."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tactibench.run import timing

pytestmark = pytest.mark.long


def test_models_are_timed_in_turns(
    monkeypatch: pytest.MonkeyPatch, cli: Any, tmp_path: Path
) -> None:
    monkeypatch.setattr(timing, "BATCHES", (1, 4))
    monkeypatch.setattr(timing, "all_threads", lambda: 1)
    code, out, err = cli(
        "speed mean nearest --train --frames 3 --calls 10 --device cpu --json speed.json"
    )
    assert code == 0, err
    assert out.startswith("exp1 on cpu; ")
    for name in ("mean", "nearest"):
        assert sum(line.startswith(name) for line in out.splitlines()) == 2
    rows = json.loads((tmp_path / "speed.json").read_text(encoding="utf-8"))["speed"]
    assert {(row["model"], row["scenario"], row["batch"]) for row in rows} == {
        (model, scenario, batch)
        for model in ("mean", "nearest")
        for scenario, batch in (("single", 1), ("offline", 1), ("offline", 4))
    }


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (("unet", "--protocol", "exp2"), "tactibench run exp2 --model unet --train-only"),
        (("mean", "mean", "--train"), "named twice"),
        (("unte",), "did you mean 'unet'?"),
        (("unet", "--regime", "several"), "no regime 'several'"),
        (("unet", "--calls", "1"), "10"),
    ],
)
def test_a_mistake_gets_one_sentence(refused: Any, options: tuple[str, ...], named: str) -> None:
    assert named in refused("speed", *options)
