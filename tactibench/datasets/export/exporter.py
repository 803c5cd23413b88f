"""Export of a data set: the formats by name, and what they have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tactibench.datasets.dataset import Dataset
from tactibench.datasets.export.bristol import write_bristol
from tactibench.datasets.export.card import write_card
from tactibench.datasets.export.parquet import write_parquet
from tactibench.datasets.export.selection import (
    Selection,
    only_split,
    rest_bytes,
    select_samples,
)
from tactibench.datasets.schema import HEADER
from tactibench.datasets.storage import new_folder, write_new_text
from tactibench.errors import UserError, did_you_mean

CARD = "README.md"
REST, HEADER_COPY = "rest.png", "header.json"
"""Files beside Parquet files; called dataset.json, the header would make them a data set."""
BRISTOL, CARD_FORMAT, PARQUET = EXPORT_FORMATS = ("bristol", "card", "hf-parquet")


@dataclass(frozen=True)
class Export:
    """The folder or file that an export made.

    Attributes:
        path: A folder or a file.
        samples: Number of samples in it.
        bad: Number of samples that were left out for their status.
        subsets: Subset of the split -> number of samples, empty without a split.
        files: Number of files.
        size_bytes: Size of all files.
    """

    path: Path
    samples: int
    bad: int
    subsets: dict[str, int]
    files: int
    size_bytes: int


def export_dataset(
    dataset: Dataset,
    target: Path,
    format: str,  # noqa: A002 - what the option is called
    *,
    split: str | None = None,
    advance: Callable[[int], None] = lambda _: None,
) -> Export:
    """Write a data set in another format; all of it, or nothing.

    Samples that are marked bad are left out of the copies.

    Args:
        dataset: The data set.
        target: A new or empty folder; of ``card`` a folder that is there, or the name of a new
            file.
        format: One of EXPORT_FORMATS.
        split: Split whose subsets become files of their own; None: the only one there is. The
            files of ``bristol`` are not divided.
        advance: Called with the number of samples that were finished.

    Raises:
        UserError: The format or the split is unknown, the target is taken, or an image is damaged.
    """
    if format not in EXPORT_FORMATS:
        raise UserError(f"unknown format {format!r}; {did_you_mean(format, EXPORT_FORMATS)}")
    if format == CARD_FORMAT:
        path = target / CARD if target.is_dir() else target
        write_new_text(path, write_card(dataset, dataset.samples))
        return Export(path, len(dataset.samples), 0, {}, 1, path.stat().st_size)
    if split is None and format == PARQUET:
        split = only_split(dataset)
    selection = select_samples(dataset, split)
    with new_folder(target, dataset.folder) as folder:
        if format == BRISTOL:
            write_bristol(dataset, folder, selection, advance)
        else:
            write_parquet(dataset, folder, selection, advance)
            _copy_facts(dataset, folder)
        text = write_card(dataset, selection.samples, format, tuple(selection.subsets))
        (folder / CARD).write_text(text, encoding="utf-8", newline="\n")
        sizes = [path.stat().st_size for path in folder.rglob("*") if path.is_file()]
    return _summary(target, selection, sizes)


def _copy_facts(dataset: Dataset, folder: Path) -> None:
    """Write what Parquet files do not say: the header and the sensor at rest."""
    (folder / HEADER_COPY).write_bytes((dataset.folder / HEADER).read_bytes())
    rest = rest_bytes(dataset)
    if rest is not None:
        (folder / REST).write_bytes(rest)


def _summary(target: Path, selection: Selection, sizes: list[int]) -> Export:
    subsets = selection.subsets if selection.split else {}
    return Export(
        target,
        len(selection.samples),
        selection.bad,
        {subset: len(samples) for subset, samples in subsets.items()},
        len(sizes),
        sum(sizes),
    )
