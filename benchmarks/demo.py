"""Measure the time from mouse to answer on the page of `tactibench demo`, in headless Chromium.

    python benchmarks/demo.py [--models superpose] [--seconds 20]

A mouse drags a tip in circles over the dome, 60 moves a second. The page measures every move
(User Timing): from the time stamp of the move to the message behind the painting that shows its
answer. The time includes sensor, model, network, drawing and painting. A picture is an answer that
was shown.
It needs `pip install "tactibench[browser]"` and a Chromium (TACTIBENCH_CHROMIUM names one).
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "shared"))
from browser import chromium
from demo_page import demo_page

MOST_MS, FEWEST_A_SECOND = 60.0, 15.0
"""Largest median from mouse to answer, and least rate of pictures, with one model on 2 cores."""
MOVES_A_SECOND = 60.0
WARM_UP_S = 3.0
MEASURES = "performance.getEntriesByName('mouse to answer').map(m => [m.startTime, m.duration])"
SHOWN = "performance.getEntriesByName('answer shown').map(m => m.startTime)"


def drag(page: Any, seconds: float) -> None:
    """Press and move in a circle, once in 3 s, as fast as a hand does."""
    box = page.locator("#dome canvas").bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    began, radius = time.perf_counter(), box["width"] / 5
    page.mouse.move(middle[0] + radius, middle[1])
    page.mouse.down()
    for k in range(int(seconds * MOVES_A_SECOND)):
        turn = 2 * math.pi * k / (3 * MOVES_A_SECOND)
        page.mouse.move(middle[0] + radius * math.cos(turn), middle[1] + radius * math.sin(turn))
        time.sleep(max(0.0, began + (k + 1) / MOVES_A_SECOND - time.perf_counter()))
    page.mouse.up()


def processor_s(process: int) -> float:
    """Return the user and system time of a process, s."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--models", default="superpose")
    parser.add_argument("--seconds", type=float, default=20.0)
    asked = parser.parse_args()
    from playwright.sync_api import sync_playwright

    with demo_page(asked.models.split(",")) as (url, process), sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.goto(url)
        page.wait_for_selector("html[data-ready]", state="attached")
        drag(page, WARM_UP_S)
        page.evaluate("performance.clearMeasures(), performance.clearMarks()")
        load, before = os.getloadavg()[0], processor_s(process.pid)
        drag(page, asked.seconds)
        page.wait_for_timeout(200)
        ms = np.array(page.evaluate(MEASURES))[:, 1]
        shown = np.array(page.evaluate(SHOWN))
        used = processor_s(process.pid) - before
        browser.close()
    rate = (len(shown) - 1) / (1e-3 * (shown[-1] - shown[0]))
    p50, p90, p99 = np.percentile(ms, (50, 90, 99))
    print(f"{asked.models}: {len(ms)} moves, {len(shown)} pictures, {asked.seconds:g} s")
    print(
        f"mouse to answer: {p50:.0f} ms median, {p90:.0f} p90, {p99:.0f} p99 (wanted: {MOST_MS:g})"
    )
    print(f"pictures a second: {rate:.1f} (wanted: {FEWEST_A_SECOND:g})")
    print(f"program: {1e3 * used / len(shown):.1f} ms of processor time a picture")
    print(f"{os.cpu_count()} cores, load before it {load:.1f}")
    return int(p50 > MOST_MS or rate < FEWEST_A_SECOND)


if __name__ == "__main__":
    sys.exit(main())
