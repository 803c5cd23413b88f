"""The samples that are exported, by the subset of a split, and the files of their images."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from tactibench.datasets.dataset import Dataset
from tactibench.datasets.schema import Sample
from tactibench.datasets.splits import SUBSETS
from tactibench.errors import UserError, did_you_mean
from tactibench.png import encode_png, read_file

ALL = "train"
"""Subset of all samples where there is no split: Hugging Face's name for data without one."""
UNASSIGNED = "unassigned"
"""Subset of samples that a split does not name, such as frames that a publication dropped."""


@dataclass(frozen=True)
class Selection:
    """The samples of an export.

    Attributes:
        subsets: Subset -> its samples in the order of their ids; none is empty.
        split: Name of the split, None where there is none.
        bad: Number of samples that are left out for their status.
    """

    subsets: dict[str, tuple[Sample, ...]]
    split: str | None
    bad: int

    @property
    def samples(self) -> tuple[Sample, ...]:
        """All samples, in the order of their ids."""
        samples = (sample for subset in self.subsets.values() for sample in subset)
        return tuple(sorted(samples, key=lambda sample: sample.id))


def select_samples(dataset: Dataset, split: str | None) -> Selection:
    """Return the good samples, divided by a split; without one all are in one subset.

    Raises:
        UserError: There is no such split, or no good sample.
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
    return Selection(
        {subset: samples for subset, samples in subsets.items() if samples},
        split,
        len(dataset.samples) - len(good),
    )


def only_split(dataset: Dataset) -> str | None:
    """Return the name of the only split, None where there is none.

    Raises:
        UserError: There are several.
    """
    names = sorted(dataset.splits)
    if len(names) > 1:
        raise UserError(
            f"{dataset.folder} has several splits ({', '.join(names)}); choose one with --split."
        )
    return names[0] if names else None


def image_bytes(dataset: Dataset, sample: Sample) -> bytes:
    """Return the file of a sample's image.

    Raises:
        UserError: It is not the file that was written.
    """
    path = dataset.folder / sample.file_name
    data = read_file(path)
    if hashlib.sha256(data).hexdigest() != sample.sha256:
        raise UserError(
            f"{path} is not the file that sample {sample.id} had (its sha256 differs); see "
            f"`tactibench data verify {dataset.folder}`."
        )
    return data


def image_size(dataset: Dataset, sample: Sample) -> int:
    """Return the bytes that the file of a sample's image has.

    Raises:
        UserError: The file is missing.
    """
    path = dataset.folder / sample.file_name
    try:
        return path.stat().st_size
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror or error}.") from None


def rest_bytes(dataset: Dataset) -> bytes | None:
    """Return a PNG file of the sensor at rest; None where there is no such frame."""
    return None if dataset.rest is None else encode_png(dataset.rest)
