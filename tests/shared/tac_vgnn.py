"""The public Tac-VGNN recordings, which live outside the project."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


def tac_vgnn_folder(name: str = "") -> Path:
    """Return a folder of the recordings; without it the test is skipped."""
    default = Path(__file__).resolve().parents[3] / "shared" / "data" / "tac-vgnn"
    folder = Path(os.environ.get("TACTIBENCH_TACVGNN", default)) / name
    if not folder.is_dir():
        pytest.skip(f"the Tac-VGNN frames are not at {folder}; set TACTIBENCH_TACVGNN")
    return folder
