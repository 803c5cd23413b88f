"""Kill a process that writes a data set at random moments, and check its acknowledged samples.

    python benchmarks/kill_writer.py [--kills 200] [--folder DIR] [--seed 0] [--json FILE]

A child process opens the data set (and so repairs the files that the last one left), adds samples
one by one and in groups, and sends each acknowledged id with its sha256 through a pipe. It gets
SIGKILL while it opens or at a random moment of writing. After every kill the journal is read as
plain JSON: every id that was ever acknowledged must be there once, with its sha256, and its file
must have this sha256. At the end every image is decoded and compared with the one that was added.
Exit code 1 when anything is missing, double or different.

SIGKILL ends the process, not the machine: only a loss of power would test fsync.
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
"""Longest time of writing between two kills."""
WHILE_OPENING = 0.3
"""Share of kills that do not wait until the child writes."""


def image(number: int) -> np.ndarray:
    return np.random.default_rng(number).integers(0, 256, SHAPE, dtype=np.uint8)


def draft(number: int) -> Draft:
    scene = Scene(Indenter.dual(7.0), Pose(0.001 * number, 0.5, 10.0, depth=2.0))
    return Draft(image(number), number, scene, {"pose_1": 0.1 * number})


def write_for_ever(folder: Path, pipe: int, seed: int) -> None:
    """Add samples until the process is killed, and send each acknowledged one through a pipe.

    A line of the pipe is one write, so that it is complete or not there.
    """
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
    """Counts and errors of all kills.

    Attributes:
        kills: Number of kills.
        while_opening: Number of kills before the child began to write.
        acknowledged: Id of each acknowledged sample -> its sha256.
        lost: Acknowledged ids that are not in the journal.
        twice: Ids that are in the journal more than once.
        different: Samples whose sha256, image or scene is not the one that was added.
    """

    kills: int = 0
    while_opening: int = 0
    acknowledged: dict[int, str] = field(default_factory=dict)
    lost: set[int] = field(default_factory=set)
    twice: set[int] = field(default_factory=set)
    different: set[str] = field(default_factory=set)

    @property
    def good(self) -> bool:
        return not (self.lost or self.twice or self.different)


def kill_once(folder: Path, outcome: Outcome, rng: np.random.Generator) -> None:
    """Start a child, kill it and add the samples that it acknowledged to the outcome."""
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
    with os.fdopen(reading, "rb") as messages:
        first = b"" if opening else messages.readline()
        time.sleep(rng.uniform(0, LONGEST_S))
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        lines = (first + messages.read()).decode().splitlines()
    if not os.WIFSIGNALED(status):
        raise SystemExit("the child ended before it was killed; its error stands above")
    outcome.kills += 1
    outcome.while_opening += "ready" not in lines
    for line in lines:
        if line != "ready":
            number, sha256 = line.split()
            outcome.acknowledged[int(number)] = sha256


def check(folder: Path, outcome: Outcome, known: set[int]) -> None:
    """Compare the acknowledged samples with the journal, read as plain JSON, and with their files.

    Args:
        folder: Folder of the data set.
        outcome: Acknowledged samples; errors are added to it.
        known: Ids whose files were checked before; newly checked ids are added to it.
    """
    journal = folder / "metadata.jsonl"
    text = journal.read_bytes() if journal.exists() else b""
    rows = [json.loads(line) for line in text.split(b"\n")[:-1]]
    ids = Counter(row["id"] for row in rows)
    outcome.twice |= {number for number, times in ids.items() if times > 1}
    sha256 = {row["id"]: row["sha256"] for row in rows}
    for number, acknowledged in outcome.acknowledged.items():
        if number not in sha256:
            outcome.lost.add(number)
        elif number not in known:
            data = (folder / f"images/{number // 1000:06d}/{number:06d}.png").read_bytes()
            if not sha256[number] == acknowledged == hashlib.sha256(data).hexdigest():
                outcome.different.add(f"sha256 of {number}")
            known.add(number)


def run(folder: Path, kills: int, seed: int) -> Outcome:
    outcome, rng, checked = Outcome(), np.random.default_rng(seed), set[int]()
    encode_png(image(0))  # imports modules for which a child would have to wait
    for _ in range(kills):
        kill_once(folder, outcome, rng)
        check(folder, outcome, checked)
    dataset = open_dataset(folder)
    for sample in dataset.samples:
        if not np.array_equal(dataset.signal(sample), image(sample.id)):
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
