"""A disk that is full, a store that cannot be written, two at once, a wrong clock, Ctrl-C twice."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from same_run import in_common

from tactibench.records import (
    Record,
    StoredRun,
    open_run,
    run_names,
)


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
