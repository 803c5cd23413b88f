"""``benchmarks/determinism.py`` finds out what is not the same every time."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from fake_distribution import fake_distribution
from few_presses import few_presses

TESTS = Path(__file__).parents[1]
FRAMES = ["frames, fit", "frames, validation", "frames, test"]

pytestmark = pytest.mark.long


@pytest.fixture
def repeat(
    load_benchmark: Callable[[str], ModuleType], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., tuple[int, dict[str, Any]]]:
    """Model, sensor -> exit code, and what was made: few presses, with plugins of this test."""
    site = tmp_path / "site"
    fake_distribution(site, "unsteady-tactile", unsteady="unsteady_tactile.hooks")
    folders = [site, TESTS / "benchmarks/fake", TESTS / "run/fake"]
    before = os.environ.get("PYTHONPATH", "")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([*map(str, folders), before]))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.chdir(tmp_path)
    protocol = few_presses(tmp_path / "protocols")["exp1"]
    module, file = load_benchmark("determinism"), tmp_path / "found.json"

    def run(model: str, sensor: str = "still") -> tuple[int, dict[str, Any]]:
        options = ["--models", model, "--protocol", str(protocol), "--sensor", sensor]
        code = module.main([*options, "--json", str(file)])
        return code, json.loads(file.read_text())[model] if file.is_file() else {}

    return run


def differing(found: dict[str, dict[str, str]]) -> list[str]:
    return [what for what, hashes in found.items() if len(set(hashes.values())) > 1]


def test_what_is_the_same_is_said_to_be(repeat: Any, capsys: Any) -> None:
    code, found = repeat("steady")
    assert list(found) == [*FRAMES, "weights", "predictions", "metrics"]
    assert (code, differing(found)) == (0, [])
    assert [len(hashes) for hashes in found.values()] == [4] * 6
    assert "NOT THE SAME" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("model", "sensor", "what"),
    [
        ("shaky", "still", ["weights", "predictions", "metrics"]),  # rolls the system's dice
        ("moody", "still", ["predictions", "metrics"]),  # answers by the order of a set
        ("steady", "threaded", FRAMES),  # frames by the number of threads
    ],
)
def test_what_differs_is_found_out(
    repeat: Any, capsys: Any, model: str, sensor: str, what: list[str]
) -> None:
    code, found = repeat(model, sensor)
    assert (code, differing(found)) == (1, what)
    assert "NOT THE SAME" in capsys.readouterr().out


def test_a_process_that_fails_is_told_in_its_own_words(repeat: Any, capsys: Any) -> None:
    assert repeat("ill") == (2, {})
    assert "'alone' ended with code 1: ZeroDivisionError" in capsys.readouterr().err
