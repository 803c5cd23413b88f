"""A disk that is full, a store that cannot be written, two at once, a wrong clock, Ctrl-C twice."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from same_run import in_common
from stored_answers import write_run

from tactibench.records import (
    PARTS,
    Record,
    StoredRun,
    open_run,
    run_names,
)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 80 kB: a run, and the answers of the one that is to take its place."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=80k", "tmpfs", str(folder)]
    if sys.platform != "linux" or os.geteuid() or subprocess.run(mount, check=False).returncode:
        pytest.skip("a small disk can only be mounted by root on Linux")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_run_that_does_not_fit_leaves_the_one_before(
    small_disk: Path, first: tuple[Path, Record]
) -> None:
    (name,) = run_names(first[0] / "runs")
    run = open_run(first[0] / "runs", name)
    parts = {part: run.arrays(part) for part in PARTS}
    write_run(small_disk, run.record, parts)
    noise = np.random.default_rng(0).integers(0, 256, 200_000, dtype=np.uint8)
    with pytest.raises(OSError, match=r"space|written"):
        write_run(small_disk, run.record, {**parts, "times": {"noise": noise}})
    assert open_run(small_disk, name).arrays("truth").keys() == parts["truth"].keys()
    assert write_run(small_disk, run.record, parts).folder.is_dir()


def test_a_run_whose_replacement_was_stopped_is_completed(
    copied: Path, run: Callable[..., StoredRun]
) -> None:
    """Between the two renames: the old run has lost its name, the new one is whole."""
    store = copied / "runs"
    (name,) = run_names(store)
    record = open_run(store, name).record
    (store / name).rename(store / f".{name}.answers")
    assert run_names(store) == []
    assert run().record.metrics == record.metrics
    assert run_names(store) == [name]


def test_two_at_once_make_one_run(
    first: tuple[Path, Record], run: Callable[..., StoredRun], tmp_path: Path
) -> None:
    """Of one cache and one store; flock counts for threads that open the file as for processes."""
    found: list[dict[str, Any]] = []
    both = [threading.Thread(target=lambda: found.append(run().record)) for _ in range(2)]
    for one in both:
        one.start()
    for one in both:
        one.join()
    assert len(found) == 2
    for record in found:
        assert in_common(record) == in_common(first[1])
    assert len(run_names(tmp_path / "runs")) == 1
    assert open_run(tmp_path / "runs", found[0].name).arrays("predictions")


def test_a_clock_that_goes_backwards_changes_no_result(
    first: tuple[Path, Record],
    run: Callable[..., StoredRun],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    began = time.time()
    ticks = iter(range(10**9))
    monkeypatch.setattr(time, "time", lambda: began - 3600.0 * next(ticks))
    record = run().record
    assert in_common(record) == in_common(first[1])
    assert record.metrics == first[1].metrics
    assert run(fresh=True).record.name == record.name


SLOW = """
import signal, sys, time
import click
from tactibench.cli import main

signal.signal(signal.SIGINT, signal.default_int_handler)  # tests may be a background job

@click.command()
def waits():
    try:
        print("waiting", flush=True)
        time.sleep(60)
    finally:
        print("closing", flush=True)
        time.sleep(60)

main.main.add_command(waits)
main.Verbs.get_command = lambda *_: waits
sys.argv = ["tactibench", "waits"]
main.run()
"""


def test_ctrl_c_twice_ends_at_once_without_a_traceback() -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", SLOW], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "waiting\n"
    process.send_signal(signal.SIGINT)
    assert process.stdout.readline() == "closing\n"
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=30)
    assert process.returncode == 130
    assert error == "tactibench: stopped; the same command continues where it was.\n"
