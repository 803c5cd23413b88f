"""Measure how fast a data set is written and read.

    python benchmarks/dataset.py [--count 2000] [--size 128] [--folder DIR] [--rounds 3]

Frames are smooth pictures with noise of 3 levels, which compress like a tactile sensor's.

* writes: samples/s acknowledged one by one (`add`) and in groups (`add_many`), each of which is
  synced to the disk, and in bulk (one sync at the end). Beside them the milliseconds of a bare
  fsync, and the rate of encoding alone, which no way of writing can beat.
* reads: frames/s of random batches through the memory map, and decoded from the PNG files.

Printed are medians over rounds, and in brackets the fastest. "cpu us" is the processor time of one
sample (fastest round), which hardly depends on other work of the machine: a free core does at most
1e6 / cpu in a second. --folder must be on the disk to be measured.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from tactibench import Indenter, Pose, Scene
from tactibench.datasets import Dataset, Draft, Header, Writer, open_dataset
from tactibench.png import encode_png

BATCH = 64


def drafts(count: int, size: int) -> list[Draft]:
    rng = np.random.default_rng(0)
    smooth = cv2.GaussianBlur(rng.normal(128, 400, (size, size)), (0, 0), 3)
    poses = rng.uniform(-6, 6, (count, 2)).tolist()
    return [
        Draft(
            np.clip(np.rint(smooth + rng.normal(0, 3, (size, size))), 0, 255).astype(np.uint8),
            number,
            Scene(Indenter.single(), Pose(x, y, depth=2.0)),
        )
        for number, (x, y) in enumerate(poses)
    ]


class Seconds(NamedTuple):
    """Seconds of one sample.

    Attributes:
        wall: By the clock on the wall.
        cpu: Of all processors.
    """

    wall: float
    cpu: float


def timed(work: Callable[[], object], count: int) -> Seconds:
    start, before = time.perf_counter(), time.process_time()
    work()
    wall, cpu = time.perf_counter() - start, time.process_time() - before
    return Seconds(wall / count, cpu / count)


def written(folder: Path, size: int, several: list[Draft], group: int, *, fsync: bool) -> Seconds:
    """Return the time of a sample in opening, writing and closing a data set.

    Args:
        folder: Folder of the data set; it is removed first.
        size: Side of the frames, px.
        several: Samples to write.
        group: Number of samples that are acknowledged together.
        fsync: Whether each group is synced to the disk.
    """
    shutil.rmtree(folder, ignore_errors=True)
    header = Header("bench", {}, (size, size), dome_radius_mm=20.0)

    def work() -> None:
        with Writer(folder, header, fsync=fsync) as writer:
            for at in range(0, len(several), group):
                writer.add_many(several[at : at + group])

    return timed(work, len(several))


def bare_fsync(folder: Path) -> Seconds:
    """Return the median time of 50 fsyncs of one small file."""
    path = folder / "probe"
    with path.open("wb") as stream:

        def one() -> None:
            stream.write(b"x" * 600)
            stream.flush()
            os.fsync(stream.fileno())

        each = [timed(one, 1) for _ in range(50)]
    return Seconds(*(statistics.median(times) for times in zip(*each, strict=True)))


def read(dataset: Dataset, count: int, *, cached: bool) -> Seconds:
    """Return the time of a frame in ``count`` frames that are read in random batches.

    Args:
        dataset: Data set to read.
        count: Number of frames.
        cached: Whether to read the memory map; else the PNG files are decoded.
    """
    order = np.random.default_rng(1).integers(0, len(dataset.samples), (count // BATCH, BATCH))
    batches = [[dataset.samples[row] for row in rows] for rows in order.tolist()]

    def work() -> None:
        for batch in batches:
            if cached:
                dataset.images(batch)
            else:
                np.stack([dataset.image(sample) for sample in batch])

    return timed(work, order.size)


def show(name: str, each: list[Seconds], others: list[Seconds] | None = None, of: str = "") -> None:
    wall = statistics.median(seconds.wall for seconds in each)
    line = (
        f"{name:30}{1 / wall:9,.0f} /s [{1 / min(seconds.wall for seconds in each):9,.0f}]"
        f"{1e6 * min(seconds.cpu for seconds in each):8,.0f} cpu us"
    )
    if others is not None:
        line += f"{statistics.median(seconds.wall for seconds in others) / wall:8.2f} x {of}"
    print(line, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=2000, help="samples of a round")
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--group", type=int, default=64, help="samples acknowledged together")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()))
    asked = parser.parse_args()
    samples = drafts(asked.count, asked.size)
    with tempfile.TemporaryDirectory(dir=asked.folder) as place:
        folder = Path(place) / "set"
        few = samples[: max(1, asked.count // 10)]
        pictures = [np.asarray(draft.signal, dtype=np.uint8) for draft in few]
        works: dict[str, Callable[[], Seconds]] = {
            "encode": lambda: timed(lambda: [encode_png(p) for p in pictures], len(pictures)),
            "fsync": lambda: bare_fsync(Path(place)),
            "add": lambda: written(folder, asked.size, few, 1, fsync=True),
            "add_many": lambda: written(folder, asked.size, samples, asked.group, fsync=True),
            "bulk": lambda: written(folder, asked.size, samples, asked.group, fsync=False),
        }
        times: dict[str, list[Seconds]] = {}
        for _ in range(asked.rounds):  # in turn, so that a busy moment meets all of them
            for name, work in works.items():
                times.setdefault(name, []).append(work())
        waits = [seconds.wall for seconds in times["fsync"]]
        print(
            f"{asked.count:,} frames of {asked.size}x{asked.size}, {os.cpu_count()} cores, "
            f"fsync of a small file {1e3 * statistics.median(waits):.2f} ms "
            f"[{1e3 * min(waits):.2f}]"
        )
        show("encode only, one thread", times["encode"])
        show("write, synced one by one", times["add"], times["fsync"], "a bare fsync")
        show(f"write, synced {asked.group} together", times["add_many"], times["add"], "one by one")
        show("write, bulk", times["bulk"], times["add"], "one by one")
        dataset = open_dataset(folder)
        make = [timed(lambda: dataset.images(dataset.samples[:1]), asked.count)]
        cached, decoded = [], []
        for _ in range(asked.rounds):
            cached.append(read(dataset, 32 * BATCH * 10, cached=True))
            decoded.append(read(dataset, 16 * BATCH, cached=False))
        show("make the array", make)
        show("read batches, PNG files", decoded)
        show("read batches, array", cached, decoded, "PNG files")


if __name__ == "__main__":
    main()
