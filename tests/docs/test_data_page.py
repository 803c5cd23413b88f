"""The Python of docs/data.md runs on a data set as it stands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from documented import blocks

from tactibench.datasets import Draft, Header, Writer

PAGE = Path(__file__).resolve().parents[2] / "docs" / "data.md"


def test_reading_a_data_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path / "cache"))
    grey = np.random.default_rng(0).integers(0, 255, (40, 16, 16)).astype(np.uint8)
    with Writer(Path("plates"), Header("plates", {"name": "own"}, (16, 16)), fsync=False) as writer:
        writer.add_many([Draft(image, number) for number, image in enumerate(grey)])
    (block,) = [b for b in blocks(PAGE.read_text(encoding="utf-8")) if b.language == "python"]
    names: dict[str, object] = {}
    exec(block.text, names)  # noqa: S102
    assert np.array_equal(names["frame"], grey[0])
