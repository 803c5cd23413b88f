"""Whether workers elsewhere are of use: they see the store and the cache, and run this code."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from tactibench import __version__
from tactibench.errors import UserError
from tactibench.records.identity import code_hash
from tactibench.sweep.engine import Engine
from tactibench.sweep.planned import Place


@dataclass(frozen=True)
class _Seen:
    """What a worker has: the folders it does not see, and its version and code."""

    missing: tuple[str, ...]
    version: str
    code: str


def check_workers(engine: Engine, place: Place) -> None:
    """Wait for a worker, then ask all that are there. Raises UserError naming one that is of no
    use."""
    with _marked(place.store) as store, _marked(place.cache) as cache:
        marks = {"run store": store, "cache": cache}
        _wait_for_one(engine, marks)
        answers = engine.client.run(_look, marks, on_error="return")
    here = _look({})
    for address, seen in answers.items():
        if isinstance(seen, Exception):
            raise UserError(
                f"worker {address} cannot import this tactibench ({type(seen).__name__}: {seen}); "
                "install it where the worker runs."
            )
        if seen.missing:
            which, folder = seen.missing[0], Path(marks[seen.missing[0]]).parent
            means = "--out" if which == "run store" else "TACTIBENCH_CACHE"
            raise UserError(
                f"worker {address} does not see the {which} {folder}; name a folder that all "
                f"machines share with {means}."
            )
        if seen != here:
            raise UserError(
                f"worker {address} runs tactibench {seen.version} ({seen.code[:8]}), this machine "
                f"{here.version} ({here.code[:8]}); install the same on both."
            )


def _wait_for_one(engine: Engine, marks: dict[str, str]) -> None:
    """A task makes schedulers that start workers on demand start one."""
    future = engine.submit(_look, marks)
    while not engine.any_of([future]):
        pass
    engine.client.cancel([future])


def _look(marks: dict[str, str]) -> _Seen:
    missing = tuple(name for name, mark in marks.items() if not Path(mark).is_file())
    return _Seen(missing, __version__, code_hash("tactibench"))


@contextmanager
def _marked(folder: Path) -> Iterator[str]:
    """A file in a folder, for a while; a folder that was made for it goes with it when empty."""
    new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    mark = folder / f".sweep-{os.getpid()}"
    mark.touch()
    try:
        yield str(mark)
    finally:
        mark.unlink(missing_ok=True)
        if new:
            with suppress(OSError):
                folder.rmdir()
