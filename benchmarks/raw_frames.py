"""Measure the time to cut out, light evenly and follow the pins of raw frames, and to shrink them.

python benchmarks/raw_frames.py FOLDER [--frames 100]

FOLDER is read as by ``data import``. Both ways take the same frames in one run, on one thread.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tactibench.datasets import ImportOptions, open_recording
from tactibench.images import gray, resized
from tactibench.markers import Tracker, find_pin_view


def median_ms(work: Callable[[int], object], count: int) -> float:
    """Return the median time of a call, ms; a first call, which compiles, is not counted.

    Args:
        work: Function of the number of the call.
        count: Number of calls.
    """
    work(0)
    times = []
    for number in range(count):
        start = time.perf_counter()
        work(number)
        times.append(time.perf_counter() - start)
    return 1e3 * float(np.median(times))


def main() -> None:
    """Print the milliseconds of a frame in both ways, and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--frames", type=int, default=100)
    arguments = parser.parse_args()
    import cv2

    cv2.setNumThreads(1)
    recording = open_recording(arguments.folder, ImportOptions(light="as_is"))
    images = [recording.image(row) for row in range(min(arguments.frames, len(recording)))]
    rest = recording.rest_image()
    rest = images[0] if rest is None else rest
    start = time.perf_counter()
    view = find_pin_view(rest)
    print(f"pins found in {1e3 * (time.perf_counter() - start):.0f} ms, once: {view}")
    tracker = Tracker(view.of(rest))
    even = [view.of(image) for image in images]
    size = (view.size, view.size)
    cut = median_ms(lambda k: view.of(images[k]), len(images))
    follow = median_ms(lambda k: tracker.track(even[k][None]), len(images))
    shrink = median_ms(lambda k: resized(gray(images[k]), size), len(images))
    seen = tracker.track(np.stack(even)).seen.mean()
    print(f"{len(images)} frames of {recording.kind}, {len(tracker.rest)} pins, {seen:.1%} seen")
    print(f"cut out and evenly lit  {cut:6.2f} ms")
    print(f"followed                {follow:6.2f} ms")
    print(f"both                    {cut + follow:6.2f} ms")
    print(f"only gray and shrunk    {shrink:6.2f} ms, {(cut + follow) / shrink:.1f} times less")


if __name__ == "__main__":
    main()
