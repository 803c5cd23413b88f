"""The machine and the versions that a reader needs to judge or repeat a run."""

from __future__ import annotations

import os
from typing import Any

from tactibench.records.identity import installed_versions
from tactibench.run.device import machine
from tactibench.run.fingerprint import fingerprint_hash

PACKAGES = ("numpy", "scipy", "torch", "opencv-contrib-python-headless", "tactibench")


def environment_facts() -> dict[str, Any]:
    """Fingerprint with its hash, threads, and the versions of what computes."""
    found = machine()
    return {
        **found,
        "fingerprint": fingerprint_hash(found),
        "threads": _threads(found["cores_logical"]),
        "versions": installed_versions(*PACKAGES),
    }


def _threads(cores: int | None) -> int:
    """Threads that predictions were computed with; OMP_NUM_THREADS may be a list of numbers."""
    first = os.environ.get("OMP_NUM_THREADS", "").partition(",")[0].strip()
    return int(first) if first.isdigit() and int(first) else cores or 1
