"""Splits are id lists in which no press stands on two sides."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from small_data_sets import header

from tactibench import UserError
from tactibench.datasets import Split, Writer, open_dataset, verify


def test_a_split_comes_back(open_set: Path) -> None:
    with Writer(open_set, header()) as writer:
        writer.split("by-press", train=np.array([1, 0]), test=[2, 3])
        writer.split("by-press", train=[0, 1], test=[3, 2])  # the same again
        with pytest.raises(UserError, match="divides otherwise"):
            writer.split("by-press", train=[2, 3], test=[0, 1])
    assert open_dataset(open_set).splits == {"by-press": Split((0, 1), (), (2, 3))}
    assert verify(open_set) == []


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ({"train": [0], "test": [1]}, r"leaks: ids 0 \(train\) and 1 \(test\) are of one press"),
        ({"train": [0, 1, 2], "validation": [3]}, r"leaks: ids 2 \(train\) and 3 \(validation\)"),
        ({"train": [0, 1, 1]}, "names id 1 in train and again in train"),
        ({"train": [0, 1], "test": [0]}, "names id 0 in train and again in test"),
        ({"test": [4]}, "names id 4 in test, which is no sample"),
    ],
)
def test_a_split_that_leaks_is_refused(
    open_set: Path, parts: dict[str, list[int]], says: str
) -> None:
    with Writer(open_set, header()) as writer:
        with pytest.raises(UserError, match=says):
            writer.split("bad", **parts)
        writer.split("good", train=[0, 1])
    assert list(open_dataset(open_set).splits) == ["good"]
    full = {part: parts.get(part, []) for part in ("train", "validation", "test")}
    (open_set / "splits/bad.json").write_text(json.dumps(full))  # by somebody else
    with pytest.raises(UserError, match=says):
        _ = open_dataset(open_set).splits
    assert len(verify(open_set)) == 1


@pytest.mark.parametrize(
    "name",
    ["../x", "a b"],
)
def test_a_name_stays_in_the_folder(open_set: Path, name: str) -> None:
    with Writer(open_set, header()) as writer, pytest.raises(UserError, match="cannot be called"):
        writer.split(name, train=[0, 1])


@pytest.mark.parametrize("text", ["{", "{}", '{"train": 1, "validation": [], "test": []}'])
def test_a_damaged_file_is_named(open_set: Path, text: str) -> None:
    (open_set / "splits").mkdir()
    (open_set / "splits/x.json").write_text(text)
    with pytest.raises(UserError, match=r"x\.json"):
        _ = open_dataset(open_set).splits
