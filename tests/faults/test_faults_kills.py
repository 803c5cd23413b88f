"""SIGKILL and full disks at many moments; the script that does it compares the records."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "faults.py"
FEW = ("--kills", "1", "--changes", "2", "--full", "2", "--stage", "train", "--stage", "board")
MANY = ("--kills", "50", "--changes", "40", "--full", "20")

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        not (hasattr(os, "fork") and hasattr(signal, "SIGKILL")), reason="no SIGKILL on this system"
    ),
]


@pytest.mark.parametrize("asked", [FEW, pytest.param(MANY, marks=pytest.mark.slow)], ids=len)
def test_a_stopped_command_ends_with_the_right_record(
    tmp_path: Path, asked: tuple[str, ...]
) -> None:
    file = tmp_path / "results.json"
    one = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, str(SCRIPT), *asked, "--seed", "3", "--json", str(file)],
        capture_output=True,
        text=True,
        env={**os.environ, **one},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    kills = int(asked[1])
    for result in json.loads(file.read_text()):
        assert result["lost"] == result["silent"] == 0, result
        assert result["stops"] >= (kills if " " not in result["stage"] else 1), result
