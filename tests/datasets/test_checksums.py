"""A closed data set whose files were changed or are gone says so, by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tactibench import UserError
from tactibench.datasets import (
    CHECKSUMS,
    EVENTS,
    HEADER,
    JOURNAL,
    PLAN,
    Draft,
    Header,
    Writer,
    open_dataset,
    verify,
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    header = Header("set", {"name": "skin"}, image=(6, 8))
    rng = np.random.default_rng(0)
    with Writer(tmp_path / "set", header, [{"id": k} for k in range(4)]) as writer:
        writer.reference(np.zeros((6, 8), np.uint8))
        writer.event("note", text="fine")
        for number in range(4):
            writer.add(Draft(rng.integers(0, 256, (6, 8), dtype=np.uint8), number))
        writer.split("parts", [0, 1], [2], [3])
    return tmp_path / "set"


PARTS = (EVENTS, JOURNAL, PLAN, "splits/parts.json", "images/000000/000002.png")


@pytest.mark.parametrize("name", PARTS)
def test_a_missing_part_is_named(folder: Path, name: str) -> None:
    assert verify(folder) == []
    (folder / name).unlink()
    assert any(name in finding for finding in verify(folder))


@pytest.mark.parametrize("name", [*PARTS, HEADER, CHECKSUMS])
def test_a_flipped_byte_is_refused_or_found(folder: Path, name: str) -> None:
    path = folder / name
    whole = path.read_bytes()
    for at in range(0, len(whole), max(1, len(whole) // 23)):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        try:
            found = verify(folder)
        except UserError as error:
            found = [str(error)]
        assert found, at
        path.write_bytes(whole)
    assert verify(folder) == []


def test_a_changed_header_is_not_opened_and_the_remedy_works(folder: Path) -> None:
    path = folder / HEADER
    path.write_text(path.read_text().replace("skin", "dome"))
    with pytest.raises(UserError, match=r"dataset\.json is not what it was .* delete checksums"):
        open_dataset(folder)
    (folder / CHECKSUMS).unlink()
    assert open_dataset(folder).header.sensor["name"] == "dome"


def test_a_changed_split_is_not_used(folder: Path) -> None:
    path = folder / "splits" / "parts.json"
    path.write_text('{"train": [0, 1], "validation": [3], "test": [2]}')
    dataset = open_dataset(folder)
    with pytest.raises(UserError, match=r"parts\.json is not what it was"):
        _ = dataset.splits
