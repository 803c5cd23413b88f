"""Attack `board verify` with forged records, answers and archives, and count how many get through.

    python benchmarks/attacks.py [--only WORD] [--keys]

--keys also changes every single value of a few records; it leaves out values for which the board
only has the submitter's word. Every forgery is a committed submission with one untruth in it
(tests/shared/forged.py). Prints the forgeries that were accepted, raised or took long; the exit
code is 1 where there is any.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "shared"))

import forged
from forged_files import FILES
from forged_records import FORGERIES

from tactibench.board import Source, score_again, trusted_host
from tactibench.errors import UserError
from tactibench.records import cache_folder

SLOW_S = 3.0
"""Largest processor time of a verdict on a forged file; the first of a test set draws its truth."""


def attacks(*, keys: bool) -> Iterator[tuple[str, Callable[[Path], Path]]]:
    """Yield the name of every forged submission, and the function that makes it in a folder."""
    for one in FORGERIES:
        yield f"record: {one.name}", partial(forged.forge, one)
    yield from FILES.items()
    for base in forged.BASES if keys else ():
        for one in forged.key_forgeries(base):
            if not one.name.startswith(forged.ON_WORD):
                yield f"{base}: {one.name}", partial(forged.forge, one)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="")
    parser.add_argument("--keys", action="store_true")
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    source = Source(trusted_host(), cache_folder())
    for base in sorted(forged.BASES):  # as they were committed, all must be accepted
        score_again(forged.base_file(base), source)
    results: Counter[str] = Counter()
    for name, make in attacks(keys=asked.keys):
        if asked.only not in name:
            continue
        with tempfile.TemporaryDirectory() as folder:
            path = make(Path(folder))
            began = time.process_time()
            try:
                score_again(path, source)
                result, message = "ACCEPTED", ""
            except UserError as error:
                result, message = "refused", str(error).partition(": ")[2]
            except BaseException as error:  # noqa: BLE001 - such errors are looked for
                place = traceback.extract_tb(error.__traceback__)[-1]
                result = "RAISED"
                message = f"{type(error).__name__} in {Path(place.filename).name}:{place.lineno}"
            took = time.process_time() - began
        results[result] += 1
        slow = f" SLOW {took:.1f} s" if took > SLOW_S else ""
        results["slow"] += bool(slow)
        if result != "refused" or slow or not asked.keys:
            print(f"{result:9}{name}{slow}: {message[:160]}", flush=True)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{dict(results)}, peak {peak:,.0f} MB")
    return int(bool(results["ACCEPTED"] or results["RAISED"] or results["slow"]))


if __name__ == "__main__":
    sys.exit(main())
