"""Flip bits in every kind of stored file; each must be refused, repaired or without effect.

    python benchmarks/flips.py [--flips 5000] [--seed 0]

The kinds are: a stored run (record and arrays), the cache (frames, manifests, weights,
predictions), a data set of images and one of channels (header, journal, plan, events, splits,
checksums, index), and a submission (record and answers). A flip is silent where a reader accepts it
and gets another value than before. Prints a line for each kind; the exit code is 1 where anything
is silent or raised.
"""

from __future__ import annotations

import argparse
import random
import shutil
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "shared"))

import forged
from same_run import in_common
from tiny_lab import Lab, tiny_host

from tactibench.board import Source, score_again, trusted_host
from tactibench.datasets import Draft, Header, Writer, index, open_dataset
from tactibench.datasets import verify as verify_dataset
from tactibench.errors import UserError
from tactibench.records import PARTS, open_run, run_names, with_checksum
from tactibench.run import NullReporter, RunRequest, Speed, evaluation, execute, make_plan

MEMORY = Path("/dev/shm")  # noqa: S108 - a folder of our own is made in it
STATES = ("refused", "same", "silent", "raised")


@dataclass(frozen=True)
class Kind:
    """Files of one kind.

    Attributes:
        name: Name of the kind.
        files: Files whose bits are flipped.
        read: Function that reads the files and returns comparable values, or raises UserError.
        restore: Function that puts back whatever else reading has changed.
    """

    name: str
    files: tuple[Path, ...]
    read: Callable[[], Any]
    restore: Callable[[], None] = lambda: None


def kinds(folder: Path) -> Iterator[Kind]:
    lab = Lab(folder / "lab", "few-")
    request = RunRequest(str(lab.protocols / "few-exp1.toml"), "tiny")

    def run(store: str) -> Any:
        plan = make_plan(request, tiny_host(), folder / "cache", store=folder / store)
        return execute(plan, NullReporter(), fresh=True)

    stored = run("runs")
    store = folder / "runs"
    (name,) = run_names(store)

    def read_run() -> Any:
        opened = open_run(store, name)
        arrays = {part: opened.arrays(part) for part in PARTS}
        return opened.record.json_values(), _comparable(arrays)

    yield Kind("run", tuple(sorted(stored.folder.iterdir())), read_run)
    backup = folder / "kept"
    shutil.copytree(folder / "cache", backup)

    def read_cache() -> Any:
        record = run("again").record
        return in_common(record), [row.json_values() for row in record.metrics]

    def restore_cache() -> None:
        shutil.rmtree(folder / "cache")
        shutil.copytree(backup, folder / "cache")

    for pattern in ("frames/*/*", "weights/*/*", "predictions/*.npz"):
        files = tuple(p for p in sorted((folder / "cache").glob(pattern)) if p.is_file())
        yield Kind(f"cache: {pattern.partition('/')[0]}", files, read_cache, restore_cache)
    index.SHORTEST = 4  # so that small data sets have an index, too
    for signal_kind in ("images", "channels"):
        place = folder / signal_kind
        write_dataset(place, channels=signal_kind == "channels")
        open_dataset(place)
        files = tuple(p for p in sorted(place.rglob("*")) if p.is_file() and p.name != ".lock")
        yield Kind(f"data set: {signal_kind}", files, partial(read_dataset, place))
    source = Source(trusted_host(), folder / "frames")
    base = forged.base_file("plain")
    place = forged.forge(forged.Forgery("it", "plain", _seal), folder / "submitted")

    def read_submission() -> Any:
        verdict = score_again(place, source)
        return verdict.record.json_values(), [row.json_values() for row in verdict.again]

    yield Kind(
        f"submission: {base.parent.name}", (place, place.with_suffix(".npz")), read_submission
    )


def _seal(values: dict[str, Any]) -> None:
    """Give the values of a committed record the checksum that `board add` gives it now."""
    forged.sign(values)
    values |= with_checksum(values)


def write_dataset(folder: Path, *, channels: bool) -> None:
    rng = np.random.default_rng(0)
    header = Header("set", {"name": "skin"}, signal=(4,), dome_radius_mm=20.0)
    if not channels:
        header = Header("set", {"name": "skin"}, image=(12, 16), dome_radius_mm=20.0)

    def signal() -> Any:
        if channels:
            return rng.normal(size=4).astype(np.float32)
        return rng.integers(0, 256, (12, 16), dtype=np.uint8)

    with Writer(folder, header, [{"id": k} for k in range(8)]) as writer:
        writer.reference(signal())
        writer.event("note", text="a note")
        for number in range(8):
            writer.add(Draft(signal(), number, labels={"depth": 0.25 * number}))
        writer.split("parts", [0, 1, 2], [3, 4], [5, 6, 7])


def read_dataset(folder: Path) -> Any:
    findings = verify_dataset(folder)
    if findings:
        raise UserError(findings[0])
    dataset = open_dataset(folder)
    signals = [dataset.signal(sample).tolist() for sample in dataset.samples]
    rest = dataset.rest
    return (
        dataset.header,
        list(dataset.samples),
        signals,
        None if rest is None else rest.tolist(),
        dict(dataset.splits),
        dataset.plan(),
    )


def _comparable(arrays: Any) -> Any:
    return {
        part: {n: (a.dtype.str, a.shape, a.tobytes()) for n, a in sorted(several.items())}
        for part, several in arrays.items()
    }


def flips(kind: Kind, count: int, rng: random.Random) -> Counter[str]:
    before, states = kind.read(), Counter[str]()
    for number in range(count):
        path = kind.files[number % len(kind.files)]
        content = path.read_bytes()
        if not content:
            continue
        at, bit = rng.randrange(len(content)), 1 << rng.randrange(8)
        path.write_bytes(content[:at] + bytes([content[at] ^ bit]) + content[at + 1 :])
        try:
            state = "same" if kind.read() == before else "silent"
        except UserError:
            state = "refused"
        except Exception:  # noqa: BLE001 - such errors are looked for
            state = "raised"
            traceback.print_exc(limit=-2)
        if state in ("silent", "raised"):
            print(f"  {state}: {path.name}, byte {at} of {len(content)}, bit {bit}", flush=True)
        states[state] += 1
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        kind.restore()
    return states


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flips", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    rng = random.Random(asked.seed)  # noqa: S311 - nothing secret
    total: Counter[str] = Counter()
    print(f"{'kind':24}" + "".join(f"{state:>9}" for state in STATES))
    with (  # nothing is timed here
        mock.patch.object(evaluation, "time_model", side_effect=lambda *_, **__: Speed()),
        tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as place,
    ):
        all_kinds = list(kinds(Path(place)))
        for kind in all_kinds:
            states = flips(kind, asked.flips // len(all_kinds), rng)
            print(f"{kind.name:24}" + "".join(f"{states[s]:9,}" for s in STATES), flush=True)
            total += states
    print(f"{'all':24}" + "".join(f"{total[state]:9,}" for state in STATES))
    return int(bool(total["silent"] or total["raised"]))


if __name__ == "__main__":
    sys.exit(main())
