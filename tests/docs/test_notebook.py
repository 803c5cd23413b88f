"""docs/api.ipynb, its code cells executed in order in a folder with a board."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from surroundings import surroundings

from tactibench import api

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOK = ROOT / "docs" / "api.ipynb"


def cells() -> list[dict[str, Any]]:
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert notebook["nbformat"] == 4
    return list(notebook["cells"])


def code_of(cell: dict[str, Any]) -> str:
    return "".join(cell["source"])


@pytest.mark.slow
def test_every_cell_shows_what_the_notebook_keeps(tmp_path: Path) -> None:
    work = tmp_path / "work"
    work.mkdir()
    (work / "leaderboards").symlink_to(ROOT / "leaderboards")
    script = str(ROOT / "scripts" / "run_notebook.py")
    for _ in range(2):  # the second time every run is in the store
        done = subprocess.run(
            [sys.executable, "-W", "error", script, str(work), "--check"],
            env=surroundings(tmp_path),
            capture_output=True,
            text=True,
            timeout=600,
        )
        assert done.returncode == 0, done.stdout + done.stderr
    assert (work / "frontier.png").is_file()


def test_the_notebook_uses_every_function() -> None:
    text = "\n".join(code_of(cell) for cell in cells())
    left_out = {"load_run", "place"}  # a run by its name, and what a run prints of itself
    for name in set(api.__all__) - left_out:
        if name.islower():
            assert f"api.{name}(" in text, name


def test_every_cell_that_shows_something_keeps_it() -> None:
    shown = [len(cell["outputs"]) for cell in cells() if cell["cell_type"] == "code"]
    assert sum(shown) >= len(shown) - 2
