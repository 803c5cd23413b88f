"""A sweep in processes of its own that is killed at some moment and called again.

Killed: all its processes at once, as a batch system or a lost power supply does, or the first one
alone, as a user does. The outcome is the store: every cell once, and what was there before a kill
is not run again.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from fake_distribution import fake_distribution
from few_presses import few_presses

TESTS = Path(__file__).parents[1]
SWEEP = """
protocol = ["protocols/few-exp1.toml", "protocols/few-exp2.toml"]
sensor = "toy"
model = ["toy", "mean"]
seed = [0, 1]
"""
CELLS = 8
HUNG_S = 300.0
"""Seconds after which a sweep that takes ten counts as hung, on a busy machine, too."""
UNTIMED = ("name", "metrics", "seed", "model", "protocol", "data")
"""Keys of a record that no clock has a part in."""


class SweepTrial:
    """A sweep in a folder, its undisturbed outcome and running time."""

    def __init__(self, place: Path) -> None:
        self.place = place / "sweep"
        site = self.place / "site"
        fake_distribution(site, "toy-tactile", toy="toy_tactile.hooks")
        few_presses(self.place / "protocols")
        (self.place / "sweep.toml").write_text(SWEEP, encoding="utf-8")
        path = [site, TESTS / "sweep" / "fake", TESTS / "run" / "fake"]
        known = os.environ.get("PYTHONPATH", "")
        self.environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join([*map(str, path), *filter(None, [known])]),
            "TOY_DIARY": str(self.place / "diary"),
            "TACTIBENCH_CACHE": str(self.place / "cache"),
        }
        (self.place / "diary").touch()
        began = time.perf_counter()
        code = self._wait(self._start())
        self.seconds = time.perf_counter() - began
        self.outcome = {name: self._untimed(one) for name, one in self._records().items()}
        if code or len(self.outcome) != CELLS:
            raise RuntimeError(f"the sweep ended with {code} and {len(self.outcome)} of {CELLS}")

    def killed_at(self, seconds: float, *, alone: bool) -> tuple[str, str] | None:
        """One of "right", "lost", "twice", "hung" and what was wrong; None: it was done before.

        Args:
            seconds: When it is killed.
            alone: Whether only the first process is killed.
        """
        for name in ("runs", "cache"):
            shutil.rmtree(self.place / name, ignore_errors=True)
        process = self._start()
        time.sleep(seconds)
        done = process.poll() is not None
        if alone and not done:
            process.kill()
            process.wait()
            if not self._gone(process.pid):
                self._kill_all(process)
                return "hung", "its workers outlived it"
        self._kill_all(process)
        if done:
            return None
        before = self._records()
        code = self._wait(self._start())
        after = self._records()
        if code is None:
            return "hung", f"the same command did not end in {HUNG_S:g} s"
        found = {name: self._untimed(one) for name, one in after.items()}
        if code or found != self.outcome:
            return "lost", f"exit code {code}, {len(found)} of {CELLS} cells"
        if any(after[name] != one for name, one in before.items()):
            return "twice", "a finished cell was run again"
        return "right", ""

    def _start(self) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "tactibench", "sweep", "sweep.toml", "--workers", "2"]
        return subprocess.Popen(
            command,
            cwd=self.place,
            env=self.environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    def _wait(self, process: subprocess.Popen[bytes]) -> int | None:
        try:
            return process.wait(timeout=HUNG_S)
        except subprocess.TimeoutExpired:
            self._kill_all(process)
            return None

    def _gone(self, group: int) -> bool:
        end = time.monotonic() + HUNG_S / 5
        while time.monotonic() < end:
            try:
                os.killpg(group, 0)
            except ProcessLookupError:
                return True
            time.sleep(0.05)
        return False

    def _kill_all(self, process: subprocess.Popen[bytes]) -> None:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()

    def _records(self) -> dict[str, Any]:
        paths = self.place.glob("runs/*/record.json")
        found = [json.loads(path.read_text(encoding="utf-8")) for path in paths]
        return {record["name"]: record for record in found}

    def _untimed(self, record: dict[str, Any]) -> dict[str, Any]:
        return {key: record[key] for key in UNTIMED}
