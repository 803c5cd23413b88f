"""``tactibench demo`` in a process of its own, for tests, benchmarks and recordings."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

END_S = 20


@contextmanager
def demo_page(
    arguments: Sequence[str], options: Sequence[str] = ("--no-browser",)
) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Yield the address of the page and the process; Ctrl-C ends it."""
    command = [sys.executable, "-m", "tactibench", "demo", *options, *arguments]
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores it
    try:
        started = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    finally:
        signal.signal(signal.SIGINT, before)
    with started as process:
        try:
            assert process.stdout is not None
            for line in process.stdout:
                if address := re.search(r"http://127\.0\.0\.1:\d+/", line):
                    yield address[0], process
                    break
            else:
                raise RuntimeError(f"`{' '.join(command)}` ended with {process.wait()}")
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(END_S)
            except subprocess.TimeoutExpired:  # without this, leaving the block would wait for ever
                process.kill()
                raise
