"""The command line called in this process, and stored runs to call it on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from command_line import cli, refused  # noqa: F401 - fixtures
from stored_answers import store_run

from tactibench.records.record import Record


@pytest.fixture
def stored_run(tmp_path: Path, fabricate: Callable[..., Record]) -> Callable[..., str]:
    """Keywords of ``fabricate`` -> the name of a run in ``runs``; a board's folder is there."""
    (tmp_path / "leaderboards").mkdir()

    def made(**more: Any) -> str:
        return store_run(tmp_path / "runs", fabricate(**more)).record.name

    return made
