"""kill -9 at any moment, then the same command: the same data, weights, predictions, metrics."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from same_run import in_common

TACTIBENCH = (sys.executable, "-c", "from tactibench.cli.main import run; run()")


def start(folder: Path, *more: str) -> subprocess.Popen[bytes]:
    environment = {**os.environ, "TACTIBENCH_CACHE": str(folder / "cache"), "OMP_NUM_THREADS": "1"}
    command = [*TACTIBENCH, "run", "exp1", "--quick", "--store", str(folder / "runs"), *more]
    return subprocess.Popen(
        command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )


def record(folder: Path) -> dict[str, Any]:
    (path,) = (folder / "runs").glob("*/record.json")
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    "model",
    [("unet", "--param", "model.width=8"), ("cnn", "--param", "model.epochs=3")],
    ids=["unet", "cnn"],
)
def test_a_killed_run_ends_as_an_undisturbed_one(model: tuple[str, ...], tmp_path: Path) -> None:
    import time

    options = ("--model", *model)
    began = time.monotonic()
    assert start(tmp_path / "a", *options).wait() == 0
    whole = time.monotonic() - began
    undisturbed = record(tmp_path / "a")

    kills = 0
    for moment in np.random.default_rng(8).uniform(0.1, 1.0, 6) * whole:
        process = start(tmp_path / "b", *options)
        try:
            assert process.wait(timeout=float(moment)) == 0
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            kills += 1
        else:
            break
    assert kills > 0
    assert start(tmp_path / "b", *options).wait() == 0
    resumed = record(tmp_path / "b")
    assert in_common(resumed) == in_common(undisturbed)
    assert resumed["metrics"] == undisturbed["metrics"]
    assert resumed["name"] == undisturbed["name"]
