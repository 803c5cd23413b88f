"""A closed and an open data set, each of four samples and a rest frame."""

from __future__ import annotations

from pathlib import Path

import pytest
from small_data_sets import draft, header, image

from tactibench.datasets import Writer


@pytest.fixture
def closed_set(tmp_path: Path) -> Path:
    writer = _write(tmp_path / "closed")
    writer.close()
    return writer.folder


@pytest.fixture
def open_set(tmp_path: Path) -> Path:
    writer = _write(tmp_path / "open")
    writer.leave_open()
    return writer.folder


def _write(folder: Path) -> Writer:
    writer = Writer(folder, header())
    writer.reference(image(10**6))
    writer.add_many([draft(number) for number in range(4)])
    return writer
