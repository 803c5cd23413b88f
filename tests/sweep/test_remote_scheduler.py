"""A scheduler and workers that were started before; and Ctrl-C."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("distributed", reason="the engine of sweeps is an extra of its own")
pytestmark = pytest.mark.slow

PATIENCE_S = 300.0
Command = Callable[..., subprocess.CompletedProcess[str]]


def started(*arguments: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", *arguments]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def waited_for(what: Callable[[], bool], process: subprocess.Popen[Any]) -> None:
    """Wait until it is so, while the process lives and for PATIENCE_S at most."""
    end = time.monotonic() + PATIENCE_S
    while not what():
        assert process.poll() is None, f"it ended with {process.returncode}"
        assert time.monotonic() < end, f"nothing in {PATIENCE_S:g} s"
        time.sleep(0.1)


@pytest.fixture
def scheduler(toy: Path, tmp_path: Path) -> Iterator[str]:
    """The address of a scheduler with a worker, in processes of their own."""
    file = tmp_path / "scheduler.json"
    known = ("--scheduler-file", str(file))
    options = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-show")
    processes = [started("distributed.cli.dask_scheduler", *options, *known)]
    try:
        waited_for(lambda: file.is_file() and file.read_text().endswith("}"), processes[0])
        address = json.loads(file.read_text())["address"]
        worker = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1")
        processes.append(started("distributed.cli.dask_worker", address, *worker))
        yield address
    finally:
        for process in reversed(processes):
            process.kill()
            process.wait()


def anybody_in(group: int) -> bool:
    """Return whether a process group has a process."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def test_a_running_scheduler_runs_the_cells(
    asked: Callable[[str], Path], tactibench: Command, scheduler: str, tmp_path: Path
) -> None:
    text = """
        [[sweep]]
        protocol = ["protocols/few-exp1.toml", "protocols/few-exp2.toml"]
        sensor = "toy"
        model = "toy"
        [[sweep]]
        protocol = ["protocols/few-exp1.toml", "protocols/few-exp2.toml"]
        sensor = "toy"
        model = "mean"
        device = "cuda"
    """
    done = tactibench("sweep", asked(text), "--scheduler", scheduler, "--quiet")
    assert (done.returncode, done.stderr) == (1, "")
    assert "4 cells: 2 run, 2 failed" in done.stdout
    assert done.stdout.count('device is "cuda", but no worker has the resource GPU') == 2
    assert len(list((tmp_path / "runs").glob("*/record.json"))) == 2
    left = [*tmp_path.glob("runs/.sweep-*"), *tmp_path.glob("cache/.sweep-*")]
    assert left == []
    again = tactibench("sweep", asked('model = "toy"'), "--scheduler", scheduler, "--quiet")
    assert (again.returncode, again.stderr) == (0, "")
    assert "2 cells: 2 in the store" in again.stdout


def test_an_interrupted_sweep_keeps_what_is_finished(
    asked: Callable[[str], Path], toy: Path, tmp_path: Path
) -> None:
    file = asked('model = ["toy", "toy-slow"]')
    process = subprocess.Popen(
        [sys.executable, "-m", "tactibench", "sweep", str(file), "--workers", "1", "--quiet"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        waited_for(lambda: "Slow" in toy.read_text(), process)
    except AssertionError:
        os.killpg(process.pid, signal.SIGKILL)
        raise
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert out == ""
    assert err.strip() == "tactibench: stopped; the same command continues where it was."
    assert len(list((tmp_path / "runs").glob("few-exp?-toy-single-*/record.json"))) == 2
    end = time.monotonic() + 30
    while anybody_in(process.pid) and time.monotonic() < end:
        time.sleep(0.1)
    assert not anybody_in(process.pid), "a worker is left"
