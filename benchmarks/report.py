"""Measure boards and HTML report of 200 stored runs: seconds, size, and time to open the page.

    python benchmarks/report.py [--runs 200] [--folder DIR]

The runs are made from the committed records. Their answers are moved by up to a micrometre, so that
no two runs are alike, and stored with truth that is drawn again, under other names and seeds. The
targets are: board and report together within 10 s, at most 5 MB, opened within 2 s.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tactibench.board import (
    FOLDER,
    Source,
    answers_file,
    compact,
    make_test_set,
    ranked_errors,
    read_answers_file,
    read_submissions,
    split_ranked,
    text_of,
    trusted_host,
)
from tactibench.protocols import load_protocol
from tactibench.records import Arrays, Record, arrays_hash, write_arrays, write_run

ROOT = Path(__file__).resolve().parents[1]
PROTOCOLS = ("exp1", "exp2", "exp3")
LIMIT_S, LIMIT_MB, LIMIT_OPEN_S = 10.0, 5.0, 2.0


def sources(cache: Path) -> Iterator[tuple[Record, Arrays, Arrays]]:
    """Yield committed records with their predictions and their truth, which is drawn again."""
    board, source = ROOT / "leaderboards", Source(trusted_host(), cache)
    for name in PROTOCOLS:
        protocol = load_protocol(name)
        for record in read_submissions(board, name):
            path = answers_file(board / FOLDER / name / f"{record.name}.json")
            if path.is_file() and record.test_sensor is None:
                truth = make_test_set(record, protocol, source, None).truth
                yield record, split_ranked(read_answers_file(path))[0], truth


def make(folder: Path, count: int, rng: np.random.Generator) -> None:
    """Write the folders ``runs`` and ``leaderboards`` with ``count`` runs each."""
    records = list(sources(folder / "cache"))
    for k in range(count):
        record, predicted, truth = records[k % len(records)]
        predicted = {**predicted, "xy": predicted["xy"] + rng.uniform(-1e-3, 1e-3, 2)}
        name = f"{record.name}-{k}"
        identity = {"predictions_hash": arrays_hash(predicted)}
        seed = record.seed + 10 * (k // len(records))
        images = rng.integers(0, 255, (24, 128, 128), dtype=np.uint8)
        parts: dict[str, Arrays] = {
            "truth": truth,
            "predictions": predicted,
            "times": {},
            "maps": {},
            "examples": {"index": np.arange(24), "images": images},
        }
        renamed = record.model_copy(
            update={
                "name": name,
                "seed": seed,
                "identity": record.identity.model_copy(update=identity),
            }
        )
        run = write_run(folder / "runs", renamed, parts)
        place = folder / "leaderboards" / FOLDER / record.protocol.id / f"{name}.json"
        spec = load_protocol(record.protocol.id).spec
        write_arrays(answers_file(place), {**predicted, **ranked_errors(spec, truth, predicted)})
        place.write_text(text_of(compact(run.record)), encoding="utf-8")


def timed(folder: Path, cache: Path, *command: str) -> float:
    """Run a command and return its wall seconds; they are printed with its processor time.

    Args:
        folder: Folder in which the command runs.
        cache: Cache of the command.
        *command: Arguments of ``tactibench``.
    """
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    environment = {**os.environ, "TACTIBENCH_CACHE": str(cache)}
    subprocess.run(
        [sys.executable, "-m", "tactibench", *command],
        cwd=folder,
        env=environment,
        check=True,
        stdout=subprocess.DEVNULL,
    )
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(f"  tactibench {' '.join(command):<55} {wall:6.1f} s, processor {used:5.1f} s")
    return wall


def opened(page: Path) -> tuple[float, float] | None:
    """Return the seconds until tables can be read, and until the plotting library has started.

    They count from the request of the page. None: there is no browser.
    """
    sys.path.insert(0, str(ROOT / "tests" / "shared"))
    try:
        from browser import chromium
        from playwright.sync_api import sync_playwright
    except ImportError:
        return None
    if (path := chromium()) is None:
        return None
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        tab = browser.new_page()
        start = time.perf_counter()
        tab.goto(page.as_uri(), timeout=120_000)
        readable = time.perf_counter() - start
        tab.wait_for_selector("html[data-ready]", state="attached", timeout=120_000)
        seconds = time.perf_counter() - start
        browser.close()
    return readable, seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--folder", type=Path, help="keep what is made here")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = (asked.folder or Path(temporary)).resolve()
        if not (folder / "runs").is_dir():
            make(folder, asked.runs, np.random.default_rng(0))
        print(f"{asked.runs} runs of {', '.join(PROTOCOLS)}:")
        board = timed(folder, folder / "cache", "board")
        cold = timed(folder, folder / "cold", "report", "--from", "runs", "--out", "runs.html")
        timed(folder, folder / "cold", "report", "--from", "board", "--out", "board.html")
        timed(folder, folder / "cold", "report", "--from", "board", "--out", "board.html")
        print(f"board and report of stored runs: {board + cold:.1f} s (at most {LIMIT_S:g})")
        for name in ("runs.html", "board.html"):
            size = (folder / name).stat().st_size / 1e6
            seconds = opened(folder / name)
            shown = (
                "no browser"
                if seconds is None
                else (
                    f"tables after {seconds[0]:.2f} s, figures after {seconds[1]:.2f} s "
                    f"(at most {LIMIT_OPEN_S:g} s)"
                )
            )
            print(f"{name}: {size:.2f} MB (at most {LIMIT_MB:g}), {shown}")


if __name__ == "__main__":
    main()
