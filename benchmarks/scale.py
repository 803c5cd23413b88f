"""Measure processor time and memory of `board` commands and of `report` on large boards.

    python benchmarks/scale.py [--submissions 2000]

The submissions are copies of the committed ones under other models and seeds. Printed are the
processor time of the command (user and system) and its peak of memory.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "shared"))

from forged import sign

from tactibench.records import with_checksum

ROOT = Path(__file__).parents[1]
SEEDS = 3


def write_board(folder: Path, count: int) -> None:
    """Write a board of ``count`` submissions."""
    shutil.copytree(ROOT / "leaderboards" / "published", folder / "published")
    for path, values in copies(count):
        place = folder / "submissions" / path.parent.name
        place.mkdir(parents=True, exist_ok=True)
        target = place / f"{values['name']}.json"
        target.write_text(json.dumps(values), encoding="utf-8")
        answers = path.with_suffix(".npz")
        if answers.is_file():
            shutil.copyfile(answers, target.with_suffix(".npz"))


def copies(count: int) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Yield paths and values of committed records under other models, with three seeds of each."""
    bases = sorted((ROOT / "leaderboards" / "submissions").glob("*/*.json"))
    for number in range(count):
        path = bases[number // SEEDS % len(bases)]
        values = json.loads(path.read_text(encoding="utf-8"))
        model = f"model-{number // SEEDS}"
        values["model"]["name"] = model
        values["seed"] = number % SEEDS
        values["name"] = f"{values['protocol']['id']}-{model}-s{number % SEEDS}-{number:08x}"
        # Three trainings of each model: seeds with the same weights hash would count once.
        values["identity"]["weights_hash"] = sha256(values["name"].encode()).hexdigest()
        sign(values)
        if values["identity"].get("sealed"):
            values = with_checksum(values)
        yield path, values


def cost(*words: str) -> tuple[float, float, str]:
    """Return processor seconds and peak MB of a command, and the last line of its output."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, "-c", _PEAK, *words], capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    *output, peak = (done.stdout + done.stderr).strip().splitlines() or ["0"]
    return seconds, float(peak), " ".join(output[-1:])[:100]


_PEAK = """
import resource, sys
from tactibench.cli.main import call
call(sys.argv[1:])
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, file=sys.stderr)
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--submissions", type=int, default=2000)
    parser.add_argument("--keep", type=Path, help="Write the board here and leave it.")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        board = asked.keep or Path(place) / "board"
        if not board.exists():
            write_board(board, asked.submissions)
        os.environ.pop("COLUMNS", None)
        for words in (
            ("board", "write", "--board", str(board)),
            ("board", "check", "--board", str(board)),
            ("board", "show", "exp2", "--board", str(board)),
            ("report", "--board", str(board), "--out", str(Path(place) / "report.html")),
        ):
            seconds, peak, last_line = cost(*words)
            name = " ".join(words[:2])
            print(
                f"{name:16}{seconds:8.1f} s of processor {peak:8,.0f} MB  {last_line}", flush=True
            )


if __name__ == "__main__":
    main()
