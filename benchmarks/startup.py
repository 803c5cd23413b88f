"""Measure how long ``tactibench --help`` and ``tactibench list`` take.

    python benchmarks/startup.py

Prints the median and the smallest wall time of 15 fresh processes each, beside ``python -c pass``,
the time that no program can avoid. Byte code is written by a first call, which is not counted.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import time

CASES = {
    "python -c pass": ["-c", "pass"],
    "tactibench --help": ["-m", "tactibench", "--help"],
    "tactibench list": ["-m", "tactibench", "list"],
}
TARGET_S = 0.25


def seconds(arguments: list[str]) -> float:
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    start = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True, env=environment)
    return time.perf_counter() - start


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=15)
    rounds = parser.parse_args().rounds
    for case in CASES.values():
        seconds(case)
    times: dict[str, list[float]] = {name: [] for name in CASES}
    for _ in range(rounds):  # in turn, so that a busy moment falls on all of them
        for name, case in CASES.items():
            times[name].append(seconds(case))
    slow = False
    print(f"{'command':20}{'median s':>10}{'least s':>10}")
    for name, measured in times.items():
        middle = statistics.median(measured)
        slow |= middle > TARGET_S
        print(f"{name:20}{middle:10.3f}{min(measured):10.3f}")
    print(f"target: median at most {TARGET_S} s: {'missed' if slow else 'met'}")
    return int(slow)


if __name__ == "__main__":
    sys.exit(main())
