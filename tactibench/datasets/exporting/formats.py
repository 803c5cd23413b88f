"""The formats by name, and what all exports have in common."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tactibench.datasets import Dataset
from tactibench.datasets.exporting.bristol import write_bristol
from tactibench.datasets.exporting.card import card
from tactibench.datasets.exporting.chosen import Chosen, choose, only_split
from tactibench.datasets.exporting.croissant import croissant
from tactibench.datasets.exporting.frames import rest_file
from tactibench.datasets.exporting.loading import files_of, native_files
from tactibench.datasets.exporting.parquet import write_parquet
from tactibench.datasets.exporting.place import new_folder, write_new
from tactibench.datasets.exporting.webdataset import write_webdataset
from tactibench.datasets.schema import HEADER
from tactibench.errors import UserError, did_you_mean

CARD, CROISSANT = "README.md", "croissant.json"
REST, WHOLE_HEADER = "rest.png", "header.json"
"""Beside files of other formats; called dataset.json, a header would make them a data set."""

Write = Callable[[Dataset, Path, Chosen, Callable[[int], None]], None]

_FOLDERS: dict[str, Write] = {
    "bristol": write_bristol,
    "hf-parquet": write_parquet,
    "webdataset": write_webdataset,
}
FORMATS = tuple(sorted((*_FOLDERS, "card", "croissant")))


@dataclass(frozen=True)
class Exported:
    """path: what was made, a folder or a file. samples: in it. bad: left out for their status.
    parts: part of the split -> samples, empty without one. files, size_bytes: of what was made."""

    path: Path
    samples: int
    bad: int
    parts: dict[str, int]
    files: int
    size_bytes: int


def export(
    dataset: Dataset,
    target: Path,
    format: str,  # noqa: A002 - what the option is called
    *,
    split: str | None = None,
    advance: Callable[[int], None] = lambda _: None,
) -> Exported:
    """Write a data set in another format; all of it, or nothing.

    target: a new or empty folder; of ``card`` and ``croissant`` a folder that is there, or the name
    of a new file. split: whose parts become files of their own; default: the only one there is, and
    none for ``bristol``, whose files are not divided.
    advance: told of finished samples. Samples that are marked bad are left out of the copies.
    Raises UserError for an unknown format, a place that is taken, a damaged image, a split that is
    not there, and what a format cannot say.
    """
    if format not in FORMATS:
        raise UserError(f"unknown format {format!r}; {did_you_mean(format, FORMATS)}")
    if format == "card":
        text = card(dataset, dataset.samples, native_files(dataset.splits))
        return _single(dataset, _file(target, CARD), text)
    if format == "croissant":
        path = _file(target, CROISSANT)
        _check_croissant(dataset, path)
        return _single(
            dataset, path, json.dumps(croissant(dataset), indent=1, ensure_ascii=False) + "\n"
        )
    if split is None and format != "bristol":
        split = only_split(dataset)
    chosen = choose(dataset, split)
    with new_folder(target, dataset.folder) as folder:
        _FOLDERS[format](dataset, folder, chosen, advance)
        _describe(dataset, folder, chosen, format)
        sizes = [path.stat().st_size for path in folder.rglob("*") if path.is_file()]
    parts = chosen.parts if chosen.split else {}
    return Exported(
        target,
        len(chosen.samples),
        chosen.bad,
        {part: len(samples) for part, samples in parts.items()},
        len(sizes),
        sum(sizes),
    )


def _describe(dataset: Dataset, folder: Path, chosen: Chosen, format_: str) -> None:
    """What every copy has beside its samples: a card, and what its own files do not say."""
    text = card(dataset, chosen.samples, files_of(format_, chosen.parts))
    (folder / CARD).write_text(text, encoding="utf-8", newline="\n")
    if format_ == "bristol":  # has its own way of saying the rest
        return
    (folder / WHOLE_HEADER).write_bytes((dataset.folder / HEADER).read_bytes())
    rest = rest_file(dataset)
    if rest is not None:
        (folder / REST).write_bytes(rest)


def _single(dataset: Dataset, path: Path, text: str) -> Exported:
    write_new(path, text)
    return Exported(path, len(dataset.samples), 0, {}, 1, path.stat().st_size)


def _file(target: Path, name: str) -> Path:
    return target / name if target.is_dir() else target


def _check_croissant(dataset: Dataset, path: Path) -> None:
    """Raises UserError where the description would not be true of the files it names."""
    if path.parent.resolve() != dataset.folder.resolve():
        raise UserError(
            f"{path} lies outside of {dataset.folder}, but a Croissant description names files "
            f"from where it lies; give {dataset.folder} itself."
        )
    if dataset.header.status != "closed":
        raise UserError(
            f"{dataset.folder} is still open: the sha256 of its journal would not hold; "
            "finish the recording first."
        )
