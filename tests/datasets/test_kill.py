"""SIGKILL at random moments of writing; the script that does it checks, and so does this test."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tactibench.datasets import open_dataset, verify

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "kill_writer.py"

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        not (hasattr(os, "fork") and hasattr(signal, "SIGKILL")), reason="no SIGKILL on this system"
    ),
]


@pytest.mark.parametrize("kills", [10, pytest.param(200, marks=pytest.mark.slow)])
def test_what_was_acknowledged_survives(tmp_path: Path, kills: int) -> None:
    folder, file = tmp_path / "set", tmp_path / "outcome.json"
    command = [
        sys.executable,
        str(SCRIPT),
        "--kills",
        str(kills),
        "--folder",
        str(folder),
        "--json",
        str(file),
        "--seed",
        "7",
    ]
    one = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **one})
    assert done.returncode == 0, done.stdout + done.stderr
    outcome = json.loads(file.read_text())
    assert outcome["kills"] == kills
    assert outcome["acknowledged"] > 0
    assert (outcome["lost"], outcome["twice"], outcome["different"]) == ([], [], [])
    ids = [sample.id for sample in open_dataset(folder).samples]
    assert len(ids) == len(set(ids)) == outcome["samples"] >= outcome["acknowledged"]
    assert verify(folder) == []
