"""The cache: a folder of files that can be made again."""

from __future__ import annotations

import os
from pathlib import Path

VARIABLE = "TACTIBENCH_CACHE"


def cache_folder() -> Path:
    """Return ``TACTIBENCH_CACHE``, or the platform's user cache."""
    given = os.environ.get(VARIABLE)
    if given:
        return Path(given).expanduser()
    import platformdirs

    return Path(platformdirs.user_cache_dir("tactibench", appauthor=False))
