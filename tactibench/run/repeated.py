"""The same work several times: whether data, weights, answers and metrics are the same bits.

Each time is a process of its own with a cache of its own and another seed of Python's own hashes:
first one alone, then two at once, and once more the frames alone on another number of threads.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tactibench.errors import UserError
from tactibench.records.cache import VARIABLE
from tactibench.run.evidence import Asked, Evidence

THREADS_VARIABLE = "OMP_NUM_THREADS"
ALONE, TWO = "alone", ("first of two at once", "second of two at once")


@dataclass(frozen=True)
class Finding:
    """Hashes of one thing, time by time: name of the time -> sha256."""

    model: str
    what: str
    hashes: Mapping[str, str]

    @property
    def same(self) -> bool:
        return len(set(self.hashes.values())) == 1

    def as_row(self) -> dict[str, Any]:
        """JSON values."""
        return {**asdict(self), "hashes": dict(self.hashes), "same": self.same}


def repeat(asked: Asked, advance: Callable[[int], None] = lambda _: None) -> list[Finding]:
    """Work four times in processes of their own and compare. advance: is told of every time.

    Raises UserError, in the words of the process, where one of them fails.
    """
    threads = os.environ.get(THREADS_VARIABLE) or str(os.cpu_count() or 1)
    other = "2" if threads == "1" else "1"
    times: dict[str, Evidence] = {}
    with tempfile.TemporaryDirectory(prefix="tactibench-") as name:
        folder = Path(name)
        for batch in ((ALONE,), TWO):
            begun = [(time, _begin(asked, folder / time, threads)) for time in batch]
            times |= _finished(begun)
            advance(len(batch))
        words = f"on {other} thread{'s' if other != '1' else ''}"
        times |= _finished([(words, _begin(asked, folder / words, other, frames_only=True))])
        advance(1)
    whats = times[ALONE]
    return [
        Finding(asked.model, what, {time: one[what] for time, one in times.items() if what in one})
        for what in whats
    ]


def steps() -> int:
    """How many times ``repeat`` tells of."""
    return 2 + len(TWO)


def _begin(
    asked: Asked, cache: Path, threads: str, *, frames_only: bool = False
) -> subprocess.Popen[str]:
    cache.mkdir()
    environment = {
        **os.environ,
        VARIABLE: str(cache),
        THREADS_VARIABLE: threads,
        # Another order of sets in each process: what depends on it shall show.
        "PYTHONHASHSEED": str(sum(map(ord, cache.name))),
    }
    text = json.dumps({**asdict(asked), "frames_only": frames_only})
    return subprocess.Popen(
        [sys.executable, "-m", "tactibench.run.evidence", text],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )


def _finished(begun: list[tuple[str, subprocess.Popen[str]]]) -> dict[str, Evidence]:
    """Wait for all; none is left behind when one fails or the user interrupts."""
    found: dict[str, Evidence] = {}
    try:
        for time, process in begun:
            out, err = process.communicate()
            if process.returncode:
                last = err.strip().splitlines()[-1:] or ["it said nothing"]
                raise UserError(
                    last[0]
                    if process.returncode == 2
                    else f"the process {time!r} ended with code {process.returncode}: {last[0]}"
                )
            found[time] = json.loads(out.splitlines()[-1])
    finally:
        for _, process in begun:
            if process.poll() is None:
                process.kill()
                process.communicate()
    return found
