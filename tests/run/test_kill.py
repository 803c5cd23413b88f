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


def frames(folder: Path) -> dict[str, bytes]:
    """Data sets in the cache: everything but locks and what is half done."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in (folder / "cache" / "frames").glob("*/*.npy")
        if path.parent.suffix == ""
    }


@pytest.mark.slow
def test_a_generation_killed_chunk_by_chunk_ends_the_same(tmp_path: Path) -> None:
    """4,000 frames: killed whenever the next chunks have appeared."""
    import time

    options = ("--model", "mean", "--param", "sensor.size=32")

    def begin(folder: Path) -> subprocess.Popen[bytes]:
        environment = {**os.environ, "TACTIBENCH_CACHE": str(folder / "cache")}
        command = [*TACTIBENCH, "run", "exp1", "--limit", "5", "--store", str(folder / "runs")]
        return subprocess.Popen([*command, *options], env=environment, stdout=subprocess.DEVNULL)

    assert begin(tmp_path / "a").wait() == 0
    rng = np.random.default_rng(3)
    kills = 0
    for _ in range(6):
        process = begin(tmp_path / "b")
        seen = len(list((tmp_path / "b").rglob("chunk-*.npz")))
        more = int(rng.integers(1, 4))
        while process.poll() is None:
            if len(list((tmp_path / "b").rglob("chunk-*.npz"))) >= seen + more:
                process.kill()
                process.wait()
                kills += 1
                break
            time.sleep(float(rng.uniform(0.001, 0.02)))
    assert kills >= 3
    assert begin(tmp_path / "b").wait() == 0
    assert frames(tmp_path / "a") == frames(tmp_path / "b")
    assert len(frames(tmp_path / "a")) == 9
    one, two = record(tmp_path / "a"), record(tmp_path / "b")
    assert in_common(one) == in_common(two)
    assert one["metrics"] == two["metrics"]
