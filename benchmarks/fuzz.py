"""Spoil inputs that strangers may send, by the ten thousand; with atheris, guided by coverage.

    python benchmarks/fuzz.py TARGET [--count 20000] [--seed 0]
    python benchmarks/fuzz.py TARGET --atheris -runs=20000     (pip install 'tactibench[fuzz]')

TARGET is protocol, sweep, hardware, record, submission, arrays, answers, table, png, weights or
words, or all (without --atheris). An input must succeed or be refused by one sentence. Anything
else is an uncaught exception and is printed with its input.
"""

from __future__ import annotations

import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "shared"))

from fuzzed import TARGETS, attempt, inputs


def guided(name: str, arguments: list[str]) -> None:
    """Hand the target to atheris, which ends the process."""
    try:
        import atheris
    except ImportError:
        sys.exit("--atheris needs the package atheris: pip install 'tactibench[fuzz]'.")
    folder, corpus = (Path(tempfile.mkdtemp(prefix=f"fuzz-{name}-")) for _ in range(2))
    for number, seed in enumerate(TARGETS[name].seeds(folder)):
        (corpus / str(number)).write_bytes(seed)
    atheris.instrument_all()
    atheris.Setup(
        [sys.argv[0], *arguments, str(corpus)], lambda data: attempt(TARGETS[name], data, folder)
    )
    atheris.Fuzz()


def random_ones(name: str, count: int, seed: int) -> int:
    """Try spoilt inputs, print a line and return the number of uncaught exceptions."""
    target, uncaught = TARGETS[name], Counter[str]()
    slowest, accepted, began = 0.0, 0, time.perf_counter()
    with tempfile.TemporaryDirectory() as place:
        for data in inputs(target, Path(place), seed, count):
            start = time.process_time()
            try:
                accepted += attempt(target, data, Path(place))
            except Exception as error:  # noqa: BLE001 - such errors are looked for
                last = traceback.extract_tb(error.__traceback__)[-1]
                key = f"{type(error).__name__} in {Path(last.filename).name}:{last.lineno}"
                if key not in uncaught:
                    print(f"{name}: {key}: {str(error)[:200]}: {data[:300]!r}", flush=True)
                uncaught[key] += 1
            slowest = max(slowest, time.process_time() - start)
    print(
        f"{name:10}{count:8,} inputs {accepted:8,} accepted {uncaught.total():6,} uncaught "
        f"slowest {1000 * slowest:6.0f} ms {time.perf_counter() - began:6.0f} s",
        flush=True,
    )
    return uncaught.total()


def main() -> int:
    import argparse

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("target", choices=[*TARGETS, "all"])
    parser.add_argument("--count", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--atheris", action="store_true")
    asked, more = parser.parse_known_args()
    if asked.atheris:
        guided(asked.target, more)
    warnings.simplefilter("ignore")
    names = list(TARGETS) if asked.target == "all" else [asked.target]
    return min(1, sum(random_ones(name, asked.count, asked.seed) for name in names))


if __name__ == "__main__":
    sys.exit(main())
