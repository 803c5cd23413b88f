"""Parquet as the Hugging Face ``datasets`` library writes it: images embedded as PNG bytes.

The feature types stand in the schema's metadata under ``huggingface``, so that
``datasets.load_dataset("parquet", data_dir=...)`` shows images instead of bytes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactibench.datasets import Dataset, Sample
from tactibench.datasets.exporting.chosen import Chosen
from tactibench.datasets.exporting.cut import SHARD_BYTES, cut
from tactibench.datasets.exporting.frames import file_of, size_of
from tactibench.datasets.rows import write_row
from tactibench.errors import UserError

if TYPE_CHECKING:
    import pyarrow as pa

ROW_GROUP = 100
"""Rows read at once: what the Hub's viewer asks of images."""


def write_parquet(
    dataset: Dataset,
    folder: Path,
    chosen: Chosen,
    advance: Callable[[int], None],
    shard_bytes: int = SHARD_BYTES,
) -> None:
    """Write ``data/train-00000-of-00001.parquet`` ..., the columns of the journal and ``image``.

    Columns that no sample has are left out; ``extra`` is JSON text. Raises UserError where pyarrow
    is not installed.
    """
    try:
        import pyarrow.parquet as pq
    except ImportError:
        raise UserError(
            "Parquet files are written by pyarrow, which is not installed; "
            "run `pip install 'tactibench[hf]'`."
        ) from None
    schema = schema_of(chosen.samples)
    (folder / "data").mkdir()
    for part, samples in chosen.parts.items():
        shards = cut([size_of(dataset, s) for s in samples], shard_bytes)
        for number, shard in enumerate(shards):
            name = f"{part}-{number:05d}-of-{len(shards):05d}.parquet"
            with pq.ParquetWriter(folder / "data" / name, schema) as writer:
                for start in range(shard.start, shard.stop, ROW_GROUP):
                    group = samples[start : min(start + ROW_GROUP, shard.stop)]
                    writer.write_table(_table(dataset, group, schema), row_group_size=ROW_GROUP)
                    advance(len(group))


def schema_of(samples: Sequence[Sample]) -> pa.Schema:
    """Types of the columns that the samples have, with the feature types of ``datasets``."""
    import pyarrow as pa

    number, text = pa.float64(), pa.string()
    pose = ("x_mm", "y_mm", "yaw_deg", "tilt_deg", "depth_mm")
    columns: dict[str, pa.DataType] = {
        "image": pa.struct({"bytes": pa.binary(), "path": text}),
        "id": pa.int64(),
        **dict.fromkeys(("sha256", "press", "session"), text),
        "attempt": pa.int64(),
    }
    if any(s.t_frame_ns is not None for s in samples):
        columns["t_frame_ns"] = pa.int64()
    if any(s.scene is not None for s in samples):
        columns |= {
            "indenter": text,
            "indenter_radius_mm": number,
            "indenter_offsets_mm": pa.list_(pa.list_(number)),
            **dict.fromkeys(pose, number),
            "n_contacts": pa.int64(),
            "contacts_xy_mm": pa.list_(pa.list_(number)),
            "contacts_depth_mm": pa.list_(number),
        }
    labels = dict.fromkeys(name for s in samples for name in s.labels)
    if labels:
        columns["labels"] = pa.struct(dict.fromkeys(labels, number))
    if any(s.extra for s in samples):
        columns["extra"] = text
    features = {
        name: {"_type": "Image"} if name == "image" else _feature(kind)
        for name, kind in columns.items()
    }
    known = json.dumps({"info": {"features": features}}, ensure_ascii=False)
    return pa.schema(columns, metadata={"huggingface": known})


def _feature(kind: pa.DataType) -> Any:
    """The type in the words of ``datasets.Features.to_dict``; lists as all its versions read."""
    import pyarrow as pa

    if pa.types.is_struct(kind):
        return {field.name: _feature(field.type) for field in kind}
    if pa.types.is_list(kind):
        return [_feature(kind.value_type)]
    return {"_type": "Value", "dtype": {"double": "float64"}.get(str(kind), str(kind))}


def _table(dataset: Dataset, samples: Iterable[Sample], schema: pa.Schema) -> pa.Table:
    import pyarrow as pa

    rows = []
    for sample in samples:
        row = json.loads(write_row(sample, dataset.header.dome_radius_mm))
        image = {"bytes": file_of(dataset, sample), "path": Path(row.pop("file_name")).name}
        extra = {}
        if "extra" in row:
            extra["extra"] = json.dumps(row["extra"], ensure_ascii=False)
        rows.append({**row, **extra, "image": image})
    return pa.Table.from_pylist(rows, schema=schema)
