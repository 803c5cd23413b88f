"""Which pictures belong to which run, drawn once and kept beside the record."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tactibench.records.store import StoredRun


def draw_pictures(run: StoredRun, others: Sequence[StoredRun]) -> list[Path]:
    return []
