"""Which samples are exported, and in which part of a split they lie."""

from __future__ import annotations

from dataclasses import dataclass

from tactibench.datasets import Dataset, Sample
from tactibench.datasets.splits import SUBSETS
from tactibench.errors import UserError, did_you_mean

WHOLE = "train"
"""Part of all samples where there is no split: what Hugging Face calls data without one."""
UNASSIGNED = "unassigned"
"""Part of samples that a split does not name, such as frames that a publication dropped."""


@dataclass(frozen=True)
class Chosen:
    """parts: samples by part, in the order of their ids; no part is empty. split: the name of the
    split, None where there is none. bad: number of samples left out for their status."""

    parts: dict[str, tuple[Sample, ...]]
    split: str | None
    bad: int

    @property
    def samples(self) -> tuple[Sample, ...]:
        """All, in the order of their ids."""
        everyone = (sample for part in self.parts.values() for sample in part)
        return tuple(sorted(everyone, key=lambda sample: sample.id))


def choose(dataset: Dataset, split: str | None) -> Chosen:
    """Samples with status ok, divided as a split says; all in one part without a name.

    Raises UserError for a split that is not there, and for a data set without a good sample.
    """
    if split is not None and split not in dataset.splits:
        known = did_you_mean(split, dataset.splits)
        raise UserError(f"{dataset.folder} has no split {split!r}; {known}")
    good = sorted((s for s in dataset.samples if s.status == "ok"), key=lambda s: s.id)
    if not good:
        raise UserError(f"{dataset.folder} holds no good sample, so there is nothing to export.")
    part_of = dict.fromkeys((s.id for s in good), WHOLE if split is None else UNASSIGNED)
    if split is not None:
        for part in SUBSETS:
            part_of |= dict.fromkeys(getattr(dataset.splits[split], part), part)
    parts = {
        part: tuple(s for s in good if part_of[s.id] == part) for part in (*SUBSETS, UNASSIGNED)
    }
    return Chosen(
        {part: samples for part, samples in parts.items() if samples},
        split,
        len(dataset.samples) - len(good),
    )


def only_split(dataset: Dataset) -> str | None:
    """The name of the only split, None where there is none. Raises UserError for several."""
    names = sorted(dataset.splits)
    if len(names) > 1:
        raise UserError(
            f"{dataset.folder} has several splits ({', '.join(names)}); choose one with --split."
        )
    return names[0] if names else None
