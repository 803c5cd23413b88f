"""Splits: ids of training, validation and test samples, divided by press."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import ConfigDict, TypeAdapter, ValidationError

from tactibench.datasets.schema import SPLITS, Sample
from tactibench.errors import UserError
from tactibench.protocols import first_mistake
from tactibench.records import read_json, write_json

SUBSETS = ("train", "validation", "test")

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
# Hugging Face's image folders look for these words in names of files. Where one file has such a
# name, they read that file alone.
_SUBSET_WORDS = "train|training|validation|valid|dev|val|test|testing|eval|evaluation"
_SUBSET = re.compile(rf"(?:^|[-._0-9])({_SUBSET_WORDS})(?=[-._0-9]|$)")


@dataclass(frozen=True)
class Split:
    """Ids of three subsets; the samples of one press are in one subset only."""

    __pydantic_config__ = ConfigDict(strict=True, extra="forbid")

    train: tuple[int, ...]
    validation: tuple[int, ...]
    test: tuple[int, ...]

    @classmethod
    def of(
        cls, train: Sequence[int] = (), validation: Sequence[int] = (), test: Sequence[int] = ()
    ) -> Split:
        """Return the split with these ids, which are sorted in each subset."""
        lists = (train, validation, test)
        return cls(*(tuple(sorted(int(number) for number in ids)) for ids in lists))

    def subset_of(self) -> dict[int, str]:
        """Return id -> the subset that it is in."""
        return {number: subset for subset in SUBSETS for number in getattr(self, subset)}


_SPLIT_FILE = TypeAdapter(Split)


def write_split(folder: Path, name: str, split: Split, samples: Iterable[Sample]) -> None:
    """Write splits/NAME.json.

    Raises:
        UserError: An id is no sample or is named twice, a press is in two subsets, the name cannot
            be used, or another split has the name.
    """
    if not _NAME.fullmatch(name):
        raise UserError(
            f"a split cannot be called {name!r}; a name has letters, digits, '-', '_' and '.'."
        )
    if subset := _SUBSET.search(name):
        raise UserError(
            f"a split cannot be called {name!r}: with {subset[1]!r} in a file's name, Hugging Face "
            "loads that file alone; call the split after how it divides, such as 'by-press'."
        )
    check_split(split, samples, f"split {name!r}")
    path = folder / SPLITS / f"{name}.json"
    if path.exists():
        if read_split(path) == split:
            return
        raise UserError(f"{path} is there already and divides otherwise; take another name.")
    write_json(path, {subset: list(getattr(split, subset)) for subset in SUBSETS})


def check_split(split: Split, samples: Iterable[Sample], where: str) -> None:
    """Check that every id is a sample, once, and that no press is in two subsets.

    Raises:
        UserError: An id is no sample or is named twice, or a press is in two subsets; the sentence
            begins with ``where``.
    """
    press = {sample.id: sample.press for sample in samples}
    subset_of_id: dict[int, str] = {}
    first_of_press: dict[str, tuple[str, int]] = {}
    for subset in SUBSETS:
        for number in getattr(split, subset):
            if number not in press:
                raise UserError(f"{where} names id {number} in {subset}, which is no sample.")
            if number in subset_of_id:
                raise UserError(
                    f"{where} names id {number} in {subset_of_id[number]} and again in {subset}; "
                    "a sample is in one part, once."
                )
            subset_of_id[number] = subset
            first, other = first_of_press.setdefault(press[number], (subset, number))
            if first != subset:
                raise UserError(
                    f"{where} leaks: ids {other} ({first}) and {number} ({subset}) are of one "
                    f"press, {press[number]!r}; keep all samples of a press in one part."
                )


def read_split(path: Path) -> Split:
    """Read a split.

    Raises:
        UserError: The file is damaged.
    """
    try:
        return _SPLIT_FILE.validate_json(json.dumps(read_json(path)))
    except ValidationError as error:
        raise UserError(f"{path}: {first_mistake(error, Split)}") from None


def split_files(folder: Path) -> Mapping[str, Path]:
    """Return name -> file of every split of a data set."""
    return {path.stem: path for path in sorted((folder / SPLITS).glob("[!.]*.json"))}
