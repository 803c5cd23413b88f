"""Export to Parquet as the Hugging Face ``datasets`` library writes it: PNG bytes embedded.

The feature types stand in the schema's metadata under ``huggingface``, so that
``datasets.load_dataset("parquet", data_dir=...)`` shows images instead of bytes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from tactibench.datasets.schema import HEADER, SUBSETS, Dataset, Image, Sample, write_row
from tactibench.datasets.writer import new_folder
from tactibench.errors import UserError, did_you_mean
from tactibench.png import ImageKind, encode_png

if TYPE_CHECKING:
    import pyarrow as pa

REST, REST_CHANNELS, HEADER_COPY = "rest.png", "rest.npy", "header.json"
"""Files beside Parquet files. A header called dataset.json would make the folder a data set."""
ALL = "train"
"""Subset of all samples where there is no split: Hugging Face's name for data without one."""
UNASSIGNED = "unassigned"
"""Subset of samples that a split does not name, such as frames that a publication dropped."""
ROW_GROUP = 100
"""Rows that are read at once, as many as the Hub's viewer expects for images."""


@dataclass(frozen=True)
class Export:
    """The folder that an export made.

    Attributes:
        path: The folder.
        bad: Number of samples that were left out for their status.
        subsets: Subset -> number of samples.
        size_bytes: Size of all files.
    """

    path: Path
    bad: int
    subsets: dict[str, int]
    size_bytes: int


def export_dataset(
    dataset: Dataset,
    target: Path,
    *,
    split: str | None = None,
    advance: Callable[[int], None] = lambda _: None,
) -> Export:
    """Write a data set as ``data/train-00000-of-00001.parquet`` ..., completely or not at all.

    The columns are those of the journal and the signal: ``image``, or ``channels`` (float32) of a
    sensor without a camera. Columns that no sample has are left out; ``extra`` is JSON text.
    Samples that are marked bad are left out.

    Args:
        dataset: The data set.
        target: A new or empty folder.
        split: Split whose subsets become files of their own; None: the only split.
        advance: Called with the number of samples that were finished.

    Raises:
        UserError: pyarrow is not installed, the split is unknown, there are several splits and none
            is named, the target is taken, or a signal is damaged.
    """
    try:
        import pyarrow.parquet as pq
    except ImportError:
        raise UserError(
            "Parquet files need pyarrow, which is not installed; run pip install 'tactibench[hf]'."
        ) from None
    subsets = select_samples(dataset, split)
    samples = [sample for group in subsets.values() for sample in group]
    images = isinstance(dataset.header.kind, ImageKind)
    schema = _schema(_rows(dataset, samples), images=images)
    with new_folder(target, dataset.folder) as folder:
        (folder / "data").mkdir()
        for subset, members in subsets.items():
            path = folder / "data" / f"{subset}-00000-of-00001.parquet"
            with pq.ParquetWriter(path, schema) as writer:
                for start in range(0, len(members), ROW_GROUP):
                    group = members[start : start + ROW_GROUP]
                    writer.write_table(_table(dataset, group, schema), row_group_size=ROW_GROUP)
                    advance(len(group))
        (folder / HEADER_COPY).write_bytes((dataset.folder / HEADER).read_bytes())
        rest = dataset.rest
        if rest is not None and images:
            (folder / REST).write_bytes(encode_png(cast("Image", rest)))
        elif rest is not None:
            np.save(folder / REST_CHANNELS, rest)
        size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    counts = {subset: len(members) for subset, members in subsets.items()}
    return Export(target, len(dataset.samples) - len(samples), counts, size)


def select_samples(dataset: Dataset, split: str | None) -> dict[str, tuple[Sample, ...]]:
    """Return the good samples by the subset of a split; without any split all are in one subset.

    Samples are in the order of their ids, and no subset is empty.

    Args:
        dataset: The data set.
        split: Name of a split; None: the only one.

    Raises:
        UserError: The data set has no such split, several of which none is named, or no good
            sample.
    """
    names = sorted(dataset.splits)
    if split is None and len(names) > 1:
        raise UserError(
            f"{dataset.folder} has several splits ({', '.join(names)}); choose one with --split."
        )
    if split is not None and split not in names:
        advice = did_you_mean(split, names)
        raise UserError(f"{dataset.folder} has no split {split!r}; {advice}")
    good = sorted((s for s in dataset.samples if s.status == "ok"), key=lambda s: s.id)
    if not good:
        raise UserError(f"{dataset.folder} holds no good sample, so there is nothing to export.")
    if not names:
        return {ALL: tuple(good)}
    subset_of = dataset.splits[split or names[0]].subset_of()
    subsets = {
        subset: tuple(s for s in good if subset_of.get(s.id, UNASSIGNED) == subset)
        for subset in (*SUBSETS, UNASSIGNED)
    }
    return {subset: samples for subset, samples in subsets.items() if samples}


def _rows(dataset: Dataset, samples: Sequence[Sample]) -> list[dict[str, Any]]:
    """Return the columns of samples but for their signals: the keys of the journal."""
    rows = []
    for sample in samples:
        row = json.loads(write_row(sample, dataset.header.dome_radius_mm))
        del row["file_name"], row["status"]
        if "extra" in row:
            row["extra"] = json.dumps(row["extra"], ensure_ascii=False)
        rows.append(row)
    return rows


def _schema(rows: Sequence[dict[str, Any]], *, images: bool) -> pa.Schema:
    """Return the types of signal and rows, and beside them the types of ``datasets``."""
    import pyarrow as pa

    signal = pa.field("channels", pa.list_(pa.float32()))
    if images:
        signal = pa.field("image", pa.struct({"bytes": pa.binary(), "path": pa.string()}))
    names = dict.fromkeys(name for row in rows for name in row)
    contacts = {  # the same where no press touches, so that all lists are empty
        "contacts_xy_mm": pa.list_(pa.list_(pa.float64())),
        "contacts_depth_mm": pa.list_(pa.float64()),
        "contacts_force_n": pa.list_(pa.list_(pa.float64())),
    }
    types = {n: contacts.get(n) or pa.array([row.get(n) for row in rows]).type for n in names}
    fields = [signal, *(pa.field(name, kind) for name, kind in types.items())]
    features = {
        field.name: {"_type": "Image"} if field.name == "image" else _feature(field.type)
        for field in fields
    }
    metadata = json.dumps({"info": {"features": features}}, ensure_ascii=False)
    return pa.schema(fields, metadata={"huggingface": metadata})


def _feature(kind: pa.DataType) -> Any:
    """Return a type as ``datasets.Features.to_dict`` does; lists as all versions read them."""
    import pyarrow as pa

    if pa.types.is_struct(kind):
        return {field.name: _feature(field.type) for field in kind}
    if pa.types.is_list(kind):
        return [_feature(kind.value_type)]
    names = {"double": "float64", "float": "float32"}
    return {"_type": "Value", "dtype": names.get(str(kind), str(kind))}


def _table(dataset: Dataset, samples: Sequence[Sample], schema: pa.Schema) -> pa.Table:
    import pyarrow as pa

    rows = _rows(dataset, samples)
    for row, sample in zip(rows, samples, strict=True):
        if "image" in schema.names:
            name = Path(sample.file_name).name
            row["image"] = {"bytes": dataset.stored_bytes(sample), "path": name}
        else:
            row["channels"] = dataset.signal(sample).ravel()
    return pa.Table.from_pylist(rows, schema=schema)
