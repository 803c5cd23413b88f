"""``tactibench data verify``."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactibench.datasets import Draft, Header, Writer


@pytest.fixture
def data_set(tmp_path: Path) -> Path:
    with Writer(tmp_path / "set", Header("x", {}, (6, 5)), fsync=False) as writer:
        writer.add_many([Draft(np.full((6, 5), n, np.uint8), n) for n in range(30)])
    return tmp_path / "set"


def test_an_intact_data_set(cli: Any, data_set: Path, tmp_path: Path) -> None:
    code, out, err = cli("data", "verify", "set", "--json", "found.json")
    assert (code, out, err) == (0, "set: 30 samples, all as it was written\n", "")
    found = json.loads((tmp_path / "found.json").read_text())
    assert found["findings"] == []
    assert [(row["metric"], row["value"]) for row in found["metrics"]] == [
        ("samples", 30),
        ("findings", 0),
    ]


def test_findings_are_printed_and_counted(cli: Any, data_set: Path, tmp_path: Path) -> None:
    for path in sorted((data_set / "images/000000").iterdir())[:25]:
        path.write_bytes(path.read_bytes()[:-1])
    code, out, err = cli("data", "verify", "set", "--json", "found.json")
    assert (code, err) == (1, "")
    lines = out.splitlines()
    assert lines[0].startswith("set/images/000000/000000.png was changed after it was written")
    assert lines[-2] == "... and 5 more; --json FILE has all of them"
    assert lines[-1] == "set: 30 samples, 25 findings"
    assert len(json.loads((tmp_path / "found.json").read_text())["findings"]) == 25


def test_no_data_set(refused: Callable[..., str], tmp_path: Path) -> None:
    assert "nowhere is no data set" in refused("data", "verify", "nowhere")
    assert "is no data set" in refused("data", "verify", tmp_path)
