"""A v1 data set as a recording."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tactibench.datasets import Sample, open_dataset
from tactibench.datasets.importing.recording import FloatArray, Recording
from tactibench.datasets.schema import IMAGES, JOURNAL
from tactibench.errors import UserError
from tactibench.png import ImageKind

SOURCE_NAME = "source_name"
"""Key of a sample's ``extra``: what the frame was called where it was imported from."""


def read_stored(folder: Path) -> Recording:
    """The samples that are not bad. Raises UserError when there are none, or what is damaged."""
    dataset = open_dataset(folder)
    header = dataset.header
    rows = [row for row, sample in enumerate(dataset.samples) if sample.status == "ok"]
    samples = [dataset.samples[row] for row in rows]
    if not samples:
        raise UserError(f"{folder} holds no sample that is not bad; record or import some.")
    bad = len(dataset.samples) - len(samples)
    notes = [*dataset.repaired]
    if bad:
        notes.append(f"{bad:,} bad sample{'s' if bad > 1 else ''} left out.")
    if dataset.rest is None:
        notes.append("no frame of the undeformed sensor.")
    return Recording(
        "v1",
        f"schema {header.schema_version}, {header.status}",
        folder,
        folder / JOURNAL,
        _names(samples),
        tuple(folder / sample.file_name for sample in samples),
        folder / IMAGES,
        ImageKind(*header.image, header.channels == 3),
        None,
        _labels(samples),
        tuple(sample.scene for sample in samples),
        tuple(sample.press for sample in samples),
        dataset.sha256,
        about=dict(header.source),
        dome_radius_mm=header.dome_radius_mm,
        notes=tuple(notes),
        dataset=dataset,
        rows=tuple(rows),
    )


def _names(samples: Sequence[Sample]) -> tuple[str, ...]:
    """What the frames were called before, where that tells them apart; else their files."""
    names = [str(sample.extra.get(SOURCE_NAME, sample.file_name)) for sample in samples]
    if max(Counter(names).values()) > 1:
        names = [sample.file_name for sample in samples]
    return tuple(names)


def _labels(samples: Sequence[Sample]) -> dict[str, FloatArray]:
    columns = dict.fromkeys(name for sample in samples for name in sample.labels)
    return {
        name: np.array([sample.labels.get(name, np.nan) for sample in samples], dtype=np.float64)
        for name in columns
    }
