"""A browser for tests: named by TACTIBENCH_CHROMIUM, or found on the path."""

from __future__ import annotations

import os
import shutil

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")


def chromium() -> str | None:
    """Path of the program, None where there is none."""
    given = os.environ.get("TACTIBENCH_CHROMIUM")
    return given or next(filter(None, map(shutil.which, NAMES)), None)
