"""Everything that is not as it was written is found; nothing is changed."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tactibench.datasets import count_samples, open_dataset, verify


def flip(path: Path, at: int = -20) -> None:
    data = bytearray(path.read_bytes())
    data[at] ^= 1
    path.write_bytes(data)


def test_an_intact_data_set(closed_set: Path) -> None:
    told: list[int] = []
    assert verify(closed_set, told.append) == []
    assert sum(told) == count_samples(closed_set) == 4


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda f: flip(f / "images/000000/000001.png"), "000001.png"),
        (lambda f: (f / "images/000000/000001.png").unlink(), "000001.png cannot be read"),
        (lambda f: flip(f / "images/reference/rest.png"), "rest.png"),
        (lambda f: (f / "images/reference/rest.png").unlink(), "rest.png cannot be read"),
        (lambda f: flip(f / "events.jsonl", 1), "events.jsonl"),
        (lambda f: (f / "metadata.jsonl").unlink(), "metadata.jsonl"),
        (lambda f: (f / "images/000000/000777.png").touch(), "named by no line"),
        (lambda f: (f / "images/reference/000001.png").touch(), "named by no line"),
        (lambda f: (f / "images/000000/.000007.png.part").touch(), "interrupted writer"),
        (lambda f: (f / "plan.jsonl").write_text('{"id": 0}\n'), "not the plan"),
        (lambda f: shutil.rmtree(f / "images"), "cannot be read"),
    ],
)
def test_damage_is_found(closed_set: Path, damage: Callable[[Path], None], says: str) -> None:
    damage(closed_set)
    before = {p: p.read_bytes() for p in closed_set.rglob("*") if p.is_file()}
    findings = verify(closed_set)
    assert says in " ".join(findings)
    assert {p: p.read_bytes() for p in closed_set.rglob("*") if p.is_file()} == before


def test_every_bit_of_an_image_counts(closed_set: Path) -> None:
    path = closed_set / "images/000000/000003.png"
    for at in range(len(path.read_bytes())):
        flip(path, at)
        (finding,) = verify(closed_set)
        assert "000003.png" in finding
        flip(path, at)
    assert verify(closed_set) == []


def test_two_damages_are_two_findings_in_order(closed_set: Path) -> None:
    for number in (3, 1):
        flip(closed_set / f"images/000000/00000{number}.png")
    assert [
        number
        for finding in verify(closed_set)
        for number in "0123"
        if f"00000{number}.png" in finding
    ] == ["1", "3"]


def test_repairing_leaves_nothing_to_find(open_set: Path) -> None:
    journal = open_set / "metadata.jsonl"
    journal.write_bytes(journal.read_bytes()[:-40])
    (open_set / "images/000000/.000009.png.part").touch()
    assert len(verify(open_set)) == 3
    assert len(open_dataset(open_set).repaired) == 3
    assert verify(open_set) == []
