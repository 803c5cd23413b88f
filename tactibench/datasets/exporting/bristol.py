"""A folder as the Bristol tactile stack keeps it: ``sensor_images/``, ``targets*.csv``, params.

Besides the keys of that stack, the params say which column is which label, and what was pressed.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tactibench.contacts import Indenter
from tactibench.datasets import Dataset, Sample
from tactibench.datasets.exporting.bristol_columns import NAME, columns_of, limits, row_of
from tactibench.datasets.exporting.chosen import Chosen
from tactibench.datasets.exporting.frames import file_of, rest_file
from tactibench.datasets.splits import SUBSETS
from tactibench.records.files import write_json

IMAGES = "sensor_images"
REST = "image_0.png"
TARGETS = ("targets.csv", "targets_images.csv")
"""What was asked for and what there is; an export knows the second only."""


def image_name(sample: Sample) -> str:
    """``image_1.png`` for id 0: 0 is the sensor at rest."""
    return f"image_{sample.id + 1}.png"


def write_bristol(
    dataset: Dataset, folder: Path, chosen: Chosen, advance: Callable[[int], None]
) -> None:
    """Write frames, targets and params of all samples; ``splits.json`` names the parts."""
    images = folder / IMAGES
    images.mkdir()
    rest = rest_file(dataset)
    if rest is not None:
        (images / REST).write_bytes(rest)
    samples = chosen.samples
    columns = columns_of(samples)
    indenters = dict.fromkeys(s.scene.indenter for s in samples if s.scene is not None)
    labels: dict[object, int] = {one: label for label, one in enumerate(indenters, start=1)}
    rows = []
    for sample in samples:
        (images / image_name(sample)).write_bytes(file_of(dataset, sample))
        rows.append({NAME: image_name(sample), **row_of(sample, columns, labels)})
        advance(1)
    text = _csv(columns.order(), rows)
    for name in TARGETS:
        (folder / name).write_bytes(text)
    header = dataset.header
    write_json(
        folder / "collect_params.json",
        {
            **limits(rows),
            "labels": dict(columns.labels),
            "scene": dict(columns.scene),
            "name": header.name,
            "uuid": header.uuid,
            "source": dict(header.source),
        },
    )
    write_json(
        folder / "env_params.json",
        {
            "units": dict(header.units),
            "axes": header.axes,
            "frames": dict(header.frames),
            "dome_radius_mm": _finite(header.dome_radius_mm, "flat"),
            "objects": {str(label): _plain(one) for label, one in enumerate(indenters, start=1)},
            "licence": header.licence,
        },
    )
    write_json(
        folder / "sensor_image_params.json",
        {
            "image": list(header.image),
            "channels": header.channels,
            "sensor": dict(header.sensor),
            "rest": None if rest is None else REST,
        },
    )
    _write_splits(dataset, folder, {s.id: image_name(s) for s in samples})


def _csv(header: list[str], rows: list[dict[str, str]]) -> bytes:
    stream = io.StringIO(newline="")
    writer = csv.DictWriter(stream, header, restval="")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue().encode()


def _plain(indenter: Indenter) -> dict[str, Any]:
    return {
        "name": indenter.name,
        "radius_mm": _finite(indenter.radius, None),
        "offsets_mm": [list(offset) for offset in indenter.offsets],
    }


def _finite(value: float | None, otherwise: str | None) -> float | str | None:
    """Infinity has no meaning in JSON: a plate has no radius, a flat pad is called so."""
    return otherwise if value is not None and math.isinf(value) else value


def _write_splits(dataset: Dataset, folder: Path, names: dict[int, str]) -> None:
    if dataset.splits:
        write_json(
            folder / "splits.json",
            {
                split: {
                    part: [names[i] for i in getattr(ids, part) if i in names] for part in SUBSETS
                }
                for split, ids in dataset.splits.items()
            },
        )
