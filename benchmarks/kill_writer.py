"""Kill a process that writes a data set, at random moments, and look for what it had acknowledged.

    python benchmarks/kill_writer.py [--kills 200] [--folder DIR] [--seed 0] [--json FILE]

A child opens the data set (and so mends what the last one left), adds samples one by one and in
groups, and tells each acknowledged id with its sha256 through a pipe; it gets SIGKILL while it
opens or at a random moment of writing. After every kill the journal is read as plain JSON: every
id that was ever acknowledged must be there once, with its sha256, and its file must have it. At the
end every image is decoded and compared with the one that was handed over. Exit code 1 when anything
is missing, double or different.

SIGKILL takes the process, not the machine: what fsync is for needs a loss of power.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tactibench import Indenter, Pose, Scene
from tactibench.datasets import Draft, Header, Writer, open_dataset, verify
from tactibench.png import encode_png

SHAPE = (48, 64)
LONGEST_S = 0.2
"""Of writing between two kills."""
WHILE_OPENING = 0.3
"""Share of kills that do not wait until the child writes."""


def image(number: int) -> np.ndarray:
    return np.random.default_rng(number).integers(0, 256, SHAPE, dtype=np.uint8)


def draft(number: int) -> Draft:
    scene = Scene(Indenter.dual(7.0), Pose(0.001 * number, 0.5, 10.0, depth=2.0))
    return Draft(image(number), number, scene, {"pose_1": 0.1 * number})


def write_for_ever(folder: Path, pipe: int, seed: int) -> None:
    """The child. A line of the pipe is one write, so it is whole or not there."""
    rng = np.random.default_rng(seed)
    header = Header("killed", {"name": "noise"}, SHAPE, dome_radius_mm=20.0)
    with Writer(folder, header) as writer:
        os.write(pipe, b"ready\n")
        while True:
            start = len(writer.done)
            count = int(rng.choice([1, 1, 1, 2, 5, 20]))
            for sample in writer.add_many([draft(start + k) for k in range(count)]):
                os.write(pipe, f"{sample.id} {sample.sha256}\n".encode())


@dataclass
class Outcome:
    """lost: acknowledged, but not in the journal. twice: ids on two lines. different: a sha256 or
    an image that is not what was handed over. mended: what opening said, and how often."""

    kills: int = 0
    while_opening: int = 0
    acknowledged: dict[int, str] = field(default_factory=dict)
    lost: set[int] = field(default_factory=set)
    twice: set[int] = field(default_factory=set)
    different: set[str] = field(default_factory=set)
    mended: Counter[str] = field(default_factory=Counter)

    @property
    def good(self) -> bool:
        return not (self.lost or self.twice or self.different)


def kill_once(folder: Path, outcome: Outcome, rng: np.random.Generator) -> None:
    """Start a child, kill it, take down what it acknowledged."""
    reading, writing = os.pipe()
    seed, opening = int(rng.integers(2**32)), rng.random() < WHILE_OPENING
    child = os.fork()
    if child == 0:
        os.close(reading)
        try:
            write_for_ever(folder, writing, seed)
        except Exception:  # noqa: BLE001 - a fork must not run on as its parent
            traceback.print_exc()
        finally:
            os._exit(1)
    os.close(writing)
    with os.fdopen(reading, "rb") as told:
        first = b"" if opening else told.readline()
        time.sleep(rng.uniform(0, LONGEST_S))
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        lines = (first + told.read()).decode().splitlines()
    if not os.WIFSIGNALED(status):
        raise SystemExit("the child ended before it was killed; its error stands above")
    outcome.kills += 1
    outcome.while_opening += "ready" not in lines
    for line in lines:
        if line != "ready":
            number, sha256 = line.split()
            outcome.acknowledged[int(number)] = sha256


def check(folder: Path, outcome: Outcome, known: set[int]) -> None:
    """The journal as plain JSON, and the files of what is newly acknowledged. known: files that
    were looked at before."""
    journal = folder / "metadata.jsonl"
    text = journal.read_bytes() if journal.exists() else b""
    rows = [json.loads(line) for line in text.split(b"\n")[:-1]]
    ids = Counter(row["id"] for row in rows)
    outcome.twice |= {number for number, times in ids.items() if times > 1}
    sha256 = {row["id"]: row["sha256"] for row in rows}
    for number, told in outcome.acknowledged.items():
        if number not in sha256:
            outcome.lost.add(number)
        elif number not in known:
            data = (folder / f"images/{number // 1000:06d}/{number:06d}.png").read_bytes()
            if not sha256[number] == told == hashlib.sha256(data).hexdigest():
                outcome.different.add(f"sha256 of {number}")
            known.add(number)


def run(folder: Path, kills: int, seed: int) -> Outcome:
    outcome, rng, known = Outcome(), np.random.default_rng(seed), set[int]()
    encode_png(image(0))  # imports what a child would wait for
    for _ in range(kills):
        kill_once(folder, outcome, rng)
        check(folder, outcome, known)
        if (folder / "dataset.json").exists() and rng.random() < 0.5:  # else the next child mends
            for sentence in open_dataset(folder).repaired:
                outcome.mended[sentence.split()[0]] += 1
            check(folder, outcome, known)
    dataset = open_dataset(folder)
    for sample in dataset.samples:
        if not np.array_equal(dataset.image(sample), image(sample.id)):
            outcome.different.add(f"image of {sample.id}")
        if sample.scene != draft(sample.id).scene:
            outcome.different.add(f"scene of {sample.id}")
    outcome.different.update(verify(folder))
    return outcome


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--folder", type=Path, help="of the data set; default: a temporary one")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, dest="file")
    asked = parser.parse_args()
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as place:
        folder = asked.folder or Path(place) / "set"
        outcome = run(folder, asked.kills, asked.seed)
        samples = len(open_dataset(folder).samples)
    seconds = time.perf_counter() - start
    print(
        f"{outcome.kills} kills ({outcome.while_opening} before writing began) in {seconds:.0f} s"
    )
    print(
        f"{len(outcome.acknowledged):,} samples acknowledged, {samples:,} there: "
        f"{len(outcome.lost)} lost, {len(outcome.twice)} twice, "
        f"{len(outcome.different)} different"
    )
    print("mended when opened for reading:", dict(outcome.mended))
    if asked.file:
        asked.file.write_text(
            json.dumps(
                {
                    "kills": outcome.kills,
                    "acknowledged": len(outcome.acknowledged),
                    "samples": samples,
                    "lost": sorted(outcome.lost),
                    "twice": sorted(outcome.twice),
                    "different": sorted(outcome.different),
                    "good": outcome.good,
                }
            )
        )
    return 0 if outcome.good else 1


if __name__ == "__main__":
    sys.exit(main())
