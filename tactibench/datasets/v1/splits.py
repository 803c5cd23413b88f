"""Explicit id lists of training, validation and test samples, divided by press."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tactibench.datasets.v1.layout import SPLITS
from tactibench.datasets.v1.sample import Sample
from tactibench.errors import UserError
from tactibench.records.files import read_json, write_json

PARTS = ("train", "validation", "test")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_WORDS = "train|training|validation|valid|dev|val|test|testing|eval|evaluation"
_PART = re.compile(rf"(?:^|[-._0-9])({_WORDS})(?=[-._0-9]|$)")
"""What Hugging Face's image folders look for in names of files: one found, they see no other."""


@dataclass(frozen=True)
class Split:
    """Ids of three parts; samples of one press are in one part only."""

    train: tuple[int, ...]
    validation: tuple[int, ...]
    test: tuple[int, ...]

    def part_of(self) -> dict[int, str]:
        """Id -> the part that it is in."""
        return {number: part for part in PARTS for number in getattr(self, part)}


def write_split(folder: Path, name: str, split: Split, samples: Iterable[Sample]) -> None:
    """Write splits/<name>.json. Raises UserError for a split that leaks, or another one of that
    name."""
    if not _NAME.fullmatch(name):
        raise UserError(
            f"a split cannot be called {name!r}; a name has letters, digits, '-', '_' and '.'."
        )
    if part := _PART.search(name):
        raise UserError(
            f"a split cannot be called {name!r}: with {part[1]!r} in a file's name, Hugging Face "
            "loads that file alone; call the split after how it divides, such as 'by-press'."
        )
    check_split(split, samples, f"split {name!r}")
    path = folder / SPLITS / f"{name}.json"
    if path.exists():
        if read_split(path) == split:
            return
        raise UserError(f"{path} is there already and divides otherwise; take another name.")
    write_json(path, {part: list(getattr(split, part)) for part in PARTS})


def check_split(split: Split, samples: Iterable[Sample], where: str) -> None:
    """Raises UserError, which begins with ``where``, for an id that is not there or stands twice,
    and for a press in two parts."""
    press = {sample.id: sample.press for sample in samples}
    part_of_id: dict[int, str] = {}
    part_of_press: dict[str, tuple[str, int]] = {}
    for part in PARTS:
        for number in getattr(split, part):
            if number not in press:
                raise UserError(f"{where} names id {number} in {part}, which is no sample.")
            if number in part_of_id:
                raise UserError(
                    f"{where} names id {number} in {part_of_id[number]} and again in {part}; "
                    "a sample is in one part, once."
                )
            part_of_id[number] = part
            first, other = part_of_press.setdefault(press[number], (part, number))
            if first != part:
                raise UserError(
                    f"{where} leaks: ids {other} ({first}) and {number} ({part}) are of one press, "
                    f"{press[number]!r}; keep all samples of a press in one part."
                )


def read_split(path: Path) -> Split:
    """The split of a file. Raises UserError for a damaged one."""
    value = read_json(path)
    if not isinstance(value, dict) or sorted(value) != sorted(PARTS):
        raise UserError(f"{path} must hold the keys {', '.join(PARTS)}; restore it.")
    for part in PARTS:
        ids = value[part]
        if not isinstance(ids, list) or not all(type(number) is int for number in ids):
            raise UserError(f"{path}: {part} is no list of ids; restore it.")
    return Split(*(tuple(value[part]) for part in PARTS))


def split_files(folder: Path) -> Mapping[str, Path]:
    """Name -> file of every split of a data set."""
    return {path.stem: path for path in sorted((folder / SPLITS).glob("[!.]*.json"))}


def split_of(train: Sequence[int], validation: Sequence[int], test: Sequence[int]) -> Split:
    """The split of id lists, each sorted."""
    return Split(
        *(tuple(sorted(int(number) for number in ids)) for ids in (train, validation, test))
    )
