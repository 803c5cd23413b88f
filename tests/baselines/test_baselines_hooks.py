"""Declaring this plugin costs nothing."""

from __future__ import annotations

import subprocess
import sys


def test_hooks_import_nothing_heavy():
    code = (
        "import sys, tactibench_baselines.hooks; "
        "print([m for m in ('numpy', 'torch', 'cv2', 'pandas') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
