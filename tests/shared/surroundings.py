"""The environment of a process that a test starts."""

from __future__ import annotations

import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def surroundings(folder: Path, *sites: Path, **more: str) -> dict[str, str]:
    """It finds this checkout, what is in ``sites`` before it, and the programs of this
    environment, computes on one thread and keeps its cache in the folder."""
    path = [*sites, ROOT, ROOT / "plugins"]
    return {
        **os.environ,
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONPATH": os.pathsep.join(map(str, path)),
        "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]),
        "TACTIBENCH_CACHE": str(folder / "cache"),
        **more,
    }
