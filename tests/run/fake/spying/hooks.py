"""The plugin's hooks; they begin to look for the truth when they are imported."""

from __future__ import annotations

import threading
from collections.abc import Iterable

from tactibench import ModelSpec, hookimpl

from . import attacks, report


def _watch() -> None:
    ended = threading.Event()
    while not ended.wait(0.5):
        report.note("thread", attacks.threads())


attacks.patch()
threading.Thread(target=_watch, daemon=True).start()


@hookimpl
def tactibench_models() -> Iterable[ModelSpec]:
    yield ModelSpec("spy", "spying.model:Spy", "looks for the truth", deterministic=True)
