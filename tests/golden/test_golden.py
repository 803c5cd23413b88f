"""Golden values hold while code is rearranged; ``scripts/golden`` computes and compares them."""

from __future__ import annotations

import importlib.machinery
import importlib.util
import json
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "golden"


@pytest.fixture(scope="module")
def golden() -> ModuleType:
    loader = importlib.machinery.SourceFileLoader("golden", str(SCRIPT))
    spec = importlib.util.spec_from_loader("golden", loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module


def test_every_section_has_values_and_knows_its_machine(golden: ModuleType) -> None:
    for name in golden.SECTIONS:
        stored = json.loads((golden.VALUES / f"{name}.json").read_text(encoding="utf-8"))
        assert stored["values"]
        assert set(stored["machine"]) == set(golden.machine())


BEFORE: dict[str, list[Any]] = {
    "exact": ["ab"],
    "numbers": [[1.0, 2.0, None], ["mae_mm", 3]],
    "grey": [17.0],
    "metrics": [["mae_mm", "x", 0.3, 0.2, 0.4, 60], ["r2", "x", 0.9, None, None, 60]],
}


@pytest.mark.parametrize(
    ("change", "here", "elsewhere"),
    [
        ({}, 0, 0),
        ({"exact": ["cd"]}, 1, 0),
        ({"numbers": [[1.0, 2.0 + 1e-9, None], ["mae_mm", 3]]}, 1, 0),
        ({"numbers": [[1.0, 2.01, None], ["mae_mm", 3]]}, 1, 1),
        ({"numbers": [[1.0, 2.0, 0.0], ["mae_mm", 3]]}, 1, 1),
        ({"numbers": [[1.0, 2.0, None]]}, 1, 1),
        ({"numbers": [[1.0, 2.0, None], ["rmse_mm", 3]]}, 1, 1),
        ({"numbers": [[1.0, float("nan"), None], ["mae_mm", 3]]}, 1, 1),
        ({"grey": [17.2]}, 1, 1),
        ({"metrics": [["mae_mm", "x", 0.5, 0.35, 0.7, 59], BEFORE["metrics"][1]]}, 1, 0),
        ({"metrics": [["mae_mm", "x", 0.5, 0.45, 0.7, 59], BEFORE["metrics"][1]]}, 1, 1),
        ({"metrics": [BEFORE["metrics"][0], ["r2", "x", 0.8, None, None, 60]]}, 1, 1),
        ({"metrics": BEFORE["metrics"][:1]}, 1, 1),
    ],
)
def test_a_difference_is_named(
    golden: ModuleType, change: dict[str, object], here: int, elsewhere: int
) -> None:
    after = {**BEFORE, **change}
    assert len(list(golden.differences("a", BEFORE, after, True))) == here
    assert len(list(golden.differences("a", BEFORE, after, False))) == elsewhere
    assert list(golden.differences("a", None, after, False))
