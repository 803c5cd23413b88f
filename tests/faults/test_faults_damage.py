"""Flipped bytes in everything that is kept: made again or refused by name, never used."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from tactibench import UserError
from tactibench.records import (
    PARTS,
    RECORD,
    open_run,
    run_names,
)

CACHED = (
    *(f"frames/*/{name}" for name in ("frames.npy", "rest.npy", "poses.npy", "manifest.json")),
    *(f"weights/*/{name}" for name in ("weights.safetensors", "manifest.json")),
)


PARTS_OF_A_FILE = ("magic", "header", "third", "middle", "end")


def place(path: Path, part: str) -> int:
    """A byte in that part of a file."""
    size = path.stat().st_size
    return {"magic": 0, "header": 9, "third": size // 3, "middle": size // 2}.get(part, size - 2)


@pytest.mark.parametrize("part", PARTS)
def test_a_damaged_array_of_a_run_is_refused(
    part: str, copied: Path, flip: Callable[[Path, int], None]
) -> None:
    store = copied / "runs"
    (name,) = run_names(store)
    file = store / name / f"{part}.npz"
    whole, arrays = file.read_bytes(), open_run(store, name).arrays(part)
    for where in PARTS_OF_A_FILE:
        flip(file, place(file, where))
        try:
            found = open_run(store, name).arrays(part)
        except UserError as error:
            assert str(file) in str(error)  # noqa: PT017 - it may also be right
        else:  # a byte that says nothing: the time of a member of the archive, say
            assert found.keys() == arrays.keys()
            assert all((found[k] == arrays[k]).all() or k == "std" for k in found)
        file.write_bytes(whole)


def test_every_damaged_byte_of_a_record_is_refused(
    copied: Path, flip: Callable[[Path, int], None]
) -> None:
    """A digit of a metric is as damaged as a bracket."""
    store = copied / "runs"
    (name,) = run_names(store)
    file = store / name / RECORD
    whole = file.read_bytes()
    before = json.loads(whole)
    for at in range(0, len(whole), 149):
        flip(file, at)
        try:
            found = open_run(store, name).record.json_values()
            assert {**found, "identity": 0} == {**before, "identity": 0}, at
            lost = {k for k, v in before["identity"].items() if found["identity"].get(k) != v}
            assert lost <= {"sealed"}, at  # the key of the checksum itself
        except UserError as error:
            assert RECORD in str(error)  # noqa: PT017
        file.write_bytes(whole)
