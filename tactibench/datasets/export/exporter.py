"""Export of a data set: the formats by name, and the steps that they have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactibench.datasets.channels import ChannelKind
from tactibench.datasets.dataset import Dataset
from tactibench.datasets.export.bristol import write_bristol
from tactibench.datasets.export.card import write_card
from tactibench.datasets.export.parquet import write_parquet
from tactibench.datasets.schema import HEADER, Sample
from tactibench.datasets.splits import SUBSETS
from tactibench.datasets.storage import new_folder, write_new_text
from tactibench.errors import UserError, did_you_mean
from tactibench.png import encode_png

CARD = "README.md"
REST, REST_CHANNELS, HEADER_COPY = "rest.png", "rest.npy", "header.json"
"""Files beside Parquet files. A header called dataset.json would make the folder a data set."""
ALL = "train"
"""Subset of all samples where there is no split: Hugging Face's name for data without one."""
UNASSIGNED = "unassigned"
"""Subset of samples that a split does not name, such as frames that a publication dropped."""
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
    """Write a data set in another format, completely or not at all.

    Samples that are marked bad are left out of the copies.

    Args:
        dataset: The data set.
        target: A new or empty folder; for ``card`` an existing folder, or the name of a new file.
        format: One of EXPORT_FORMATS.
        split: Split whose subsets become files of their own; None: the only split. The files of
            ``bristol`` are not divided.
        advance: Called with the number of samples that were finished.

    Raises:
        UserError: The format or the split is unknown, there are several splits and none is named,
            the target is taken, or an image is damaged.
    """
    if format not in EXPORT_FORMATS:
        raise UserError(f"unknown format {format!r}; {did_you_mean(format, EXPORT_FORMATS)}")
    if format == CARD_FORMAT:
        path = target / CARD if target.is_dir() else target
        write_new_text(path, write_card(dataset, dataset.samples))
        return Export(path, len(dataset.samples), 0, {}, 1, path.stat().st_size)
    if split is None and format == PARQUET:
        split = _only_split(dataset)
    subsets = select_samples(dataset, split)
    samples = sorted((s for group in subsets.values() for s in group), key=lambda s: s.id)
    with new_folder(target, dataset.folder) as folder:
        if format == BRISTOL:
            write_bristol(dataset, folder, samples, advance)
        else:
            write_parquet(dataset, folder, subsets, advance)
            _copy_facts(dataset, folder)
        text = write_card(dataset, samples, format, tuple(subsets))
        (folder / CARD).write_text(text, encoding="utf-8", newline="\n")
        sizes = [path.stat().st_size for path in folder.rglob("*") if path.is_file()]
    return Export(
        target,
        len(samples),
        len(dataset.samples) - len(samples),
        {subset: len(group) for subset, group in subsets.items()} if split else {},
        len(sizes),
        sum(sizes),
    )


def select_samples(dataset: Dataset, split: str | None) -> dict[str, tuple[Sample, ...]]:
    """Return the good samples by the subset of a split; without a split all are in one subset.

    Samples are in the order of their ids, and no subset is empty.

    Raises:
        UserError: The data set has no such split, or no good sample.
    """
    if split is not None and split not in dataset.splits:
        advice = did_you_mean(split, dataset.splits)
        raise UserError(f"{dataset.folder} has no split {split!r}; {advice}")
    good = sorted((s for s in dataset.samples if s.status == "ok"), key=lambda s: s.id)
    if not good:
        raise UserError(f"{dataset.folder} holds no good sample, so there is nothing to export.")
    subset_of = {} if split is None else dataset.splits[split].subset_of()
    rest = ALL if split is None else UNASSIGNED
    subsets = {
        subset: tuple(s for s in good if subset_of.get(s.id, rest) == subset)
        for subset in (*SUBSETS, UNASSIGNED)
    }
    return {subset: samples for subset, samples in subsets.items() if samples}


def _only_split(dataset: Dataset) -> str | None:
    """Return the name of the only split, None where there is none.

    Raises:
        UserError: There are several splits.
    """
    names = sorted(dataset.splits)
    if len(names) > 1:
        raise UserError(
            f"{dataset.folder} has several splits ({', '.join(names)}); choose one with --split."
        )
    return names[0] if names else None


def _copy_facts(dataset: Dataset, folder: Path) -> None:
    """Write the facts that Parquet files do not hold: the header and the sensor at rest."""
    (folder / HEADER_COPY).write_bytes((dataset.folder / HEADER).read_bytes())
    if isinstance(dataset.header.kind, ChannelKind):
        if dataset.rest is not None:
            np.save(folder / REST_CHANNELS, dataset.rest)
    elif dataset.rest_image is not None:
        (folder / REST).write_bytes(encode_png(dataset.rest_image))
