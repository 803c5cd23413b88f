"""``tactibench data export``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactibench import Indenter, Pose, Scene
from tactibench.datasets import Draft, Header, Writer


@pytest.fixture
def taps(tmp_path: Path) -> Path:
    """Four good samples and a bad one, with a split."""
    folder = tmp_path / "taps"
    header = Header("taps", {"name": "tactip-127"}, (6, 5), dome_radius_mm=20.0)
    with Writer(folder, header, fsync=False) as writer:
        for number in range(5):
            writer.add(
                Draft(
                    np.full((6, 5), number, np.uint8),
                    id=number,
                    scene=Scene(Indenter.single(), Pose(depth=0.5 * number)),
                    status="bad" if number == 4 else "ok",
                )
            )
        writer.split("mine", train=[0, 1], validation=[], test=[2, 3])
    return folder


def test_it_says_what_was_written_and_what_was_left_out(
    taps: Path, cli: Any, tmp_path: Path
) -> None:
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    command = ("data", "export", "taps", "out", "--json", "figures.json")
    code, out, err = cli(*command)
    assert (code, err) == (0, "")
    assert out.startswith("out: 4 samples (train 2, test 2); 1 marked bad left out; 0.0 MB")
    rows = json.loads((tmp_path / "figures.json").read_text("utf-8"))
    found = {(row["metric"], row["group"]): row["value"] for row in rows}
    files = [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert found == {
        ("samples", "train"): 2,
        ("samples", "test"): 2,
        ("left_out", "bad"): 1,
        ("size", "all"): sum(path.stat().st_size for path in files),
    }
    code, out, err = cli(*command)
    assert (code, out) == (2, "")
    assert "nothing is overwritten" in err
