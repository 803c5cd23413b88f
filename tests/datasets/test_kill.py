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


@pytest.mark.long
@pytest.mark.skipif(
    not (hasattr(os, "fork") and hasattr(signal, "SIGKILL")), reason="no SIGKILL on this system"
)
def test_what_was_acknowledged_survives(tmp_path: Path) -> None:
    folder, file = tmp_path / "set", tmp_path / "outcome.json"
    options = ["--kills", "10", "--seed", "7", "--folder", str(folder), "--json", str(file)]
    done = subprocess.run([sys.executable, str(SCRIPT), *options], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    outcome = json.loads(file.read_text())
    assert (outcome["lost"], outcome["twice"], outcome["different"]) == ([], [], [])
    ids = [sample.id for sample in open_dataset(folder).samples]
    assert len(ids) == len(set(ids)) == outcome["samples"] >= outcome["acknowledged"] > 0
    assert verify(folder) == []
