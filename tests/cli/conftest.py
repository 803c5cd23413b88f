"""The command line called in this process, and stored runs to call it on."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import cli, refused  # noqa: F401 - fixtures
from stored_answers import store_run

from tactibench import Indenter, Pose, Scene
from tactibench.datasets import Draft, Header, Writer
from tactibench.records import Record


@pytest.fixture
def channels(tmp_path: Path) -> Path:
    """A data set of three presses, each of 15 channels."""
    folder = tmp_path / "channels"
    header = Header("skin", {"name": "skin"}, signal=(15,), dome_radius_mm=math.inf)
    with Writer(folder, header) as writer:
        writer.reference(np.zeros(15, np.float32))
        for k in range(3):
            scene = Scene(Indenter.single(), Pose(float(k), depth=2.0))
            writer.add(Draft(np.full(15, k, np.float32), k, scene))
    return folder


@pytest.fixture
def stored_run(tmp_path: Path, fabricate: Callable[..., Record]) -> Callable[..., str]:
    """Keywords of ``fabricate`` -> the name of a run in ``runs``; a board's folder is there."""
    (tmp_path / "leaderboards").mkdir()

    def made(**more: Any) -> str:
        return store_run(tmp_path / "runs", fabricate(**more)).record.name

    return made
