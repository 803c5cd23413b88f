"""Export to Parquet as the Hugging Face ``datasets`` library writes it: PNG bytes embedded.

The feature types stand in the schema's metadata under ``huggingface``, so that
``datasets.load_dataset("parquet", data_dir=...)`` shows images instead of bytes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactibench.datasets.dataset import Dataset
from tactibench.datasets.rows import MOVE_KEYS, POSE_KEYS, write_row
from tactibench.datasets.schema import Sample
from tactibench.errors import UserError
from tactibench.png import ImageKind

if TYPE_CHECKING:
    import pyarrow as pa

SHARD_BYTES = 500_000_000
"""Size to which Hugging Face divides its own Parquet files."""
ROW_GROUP = 100
"""Rows that are read at once, as many as the Hub's viewer expects for images."""


def write_parquet(
    dataset: Dataset,
    folder: Path,
    subsets: Mapping[str, Sequence[Sample]],
    advance: Callable[[int], None],
    shard_bytes: int = SHARD_BYTES,
) -> None:
    """Write ``data/train-00000-of-00001.parquet`` ...: the columns of the journal and the signal.

    The signal is the column ``image``, or ``channels`` (float32) of a sensor without a camera.
    Columns that no sample has are left out; ``extra`` is JSON text.

    Args:
        dataset: The data set.
        folder: An existing folder without ``data``.
        subsets: Subset -> its samples.
        advance: Called with the number of samples that were finished.
        shard_bytes: Largest size of the images or channels in a file, bytes.

    Raises:
        UserError: pyarrow is not installed, or an image cannot be read.
    """
    try:
        import pyarrow.parquet as pq
    except ImportError:
        raise UserError(
            "Parquet files are written by pyarrow, which is not installed; "
            "run `pip install 'tactibench[hf]'`."
        ) from None
    kind = dataset.header.kind
    samples_of_all = [sample for samples in subsets.values() for sample in samples]
    schema = parquet_schema(samples_of_all, images=isinstance(kind, ImageKind))
    (folder / "data").mkdir()
    for subset, samples in subsets.items():
        if isinstance(kind, ImageKind):
            sizes = [_file_size(dataset.folder / sample.file_name) for sample in samples]
        else:
            sizes = [kind.row_bytes] * len(samples)
        shards = divide(sizes, shard_bytes)
        for number, shard in enumerate(shards):
            name = f"{subset}-{number:05d}-of-{len(shards):05d}.parquet"
            with pq.ParquetWriter(folder / "data" / name, schema) as writer:
                for start in range(shard.start, shard.stop, ROW_GROUP):
                    group = samples[start : min(start + ROW_GROUP, shard.stop)]
                    writer.write_table(_table(dataset, group, schema), row_group_size=ROW_GROUP)
                    advance(len(group))


def _file_size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror or error}.") from None


def divide(sizes: Sequence[int], limit: int) -> list[range]:
    """Return consecutive ranges of items whose sizes add up to at most ``limit``.

    An item that is larger has a range of its own.
    """
    shards: list[range] = []
    start, total = 0, 0
    for item, size in enumerate(sizes):
        if item > start and total + size > limit:
            shards.append(range(start, item))
            start, total = item, 0
        total += size
    if sizes:
        shards.append(range(start, len(sizes)))
    return shards


def parquet_schema(samples: Sequence[Sample], *, images: bool = True) -> pa.Schema:
    """Return the types of the columns that the samples have, with the types of ``datasets``."""
    import pyarrow as pa

    number, text = pa.float64(), pa.string()
    columns: dict[str, pa.DataType] = {
        **(
            {"image": pa.struct({"bytes": pa.binary(), "path": text})}
            if images
            else {"channels": pa.list_(pa.float32())}
        ),
        "id": pa.int64(),
        **dict.fromkeys(("sha256", "press", "session"), text),
        "attempt": pa.int64(),
    }
    if any(sample.t_frame_ns is not None for sample in samples):
        columns["t_frame_ns"] = pa.int64()
    scenes = [sample.scene for sample in samples if sample.scene is not None]
    if scenes:
        moves = MOVE_KEYS if any(scene.pose.moved for scene in scenes) else ()
        columns |= {
            "indenter": text,
            "indenter_radius_mm": number,
            "indenter_offsets_mm": pa.list_(pa.list_(number)),
            **dict.fromkeys((*POSE_KEYS, *moves), number),
            "n_contacts": pa.int64(),
            "contacts_xy_mm": pa.list_(pa.list_(number)),
            "contacts_depth_mm": pa.list_(number),
        }
    labels = dict.fromkeys(name for sample in samples for name in sample.labels)
    if labels:
        columns["labels"] = pa.struct(dict.fromkeys(labels, number))
    if any(sample.extra for sample in samples):
        columns["extra"] = text
    features = {
        name: {"_type": "Image"} if name == "image" else _feature(kind)
        for name, kind in columns.items()
    }
    metadata = json.dumps({"info": {"features": features}}, ensure_ascii=False)
    return pa.schema(columns, metadata={"huggingface": metadata})


def _feature(kind: pa.DataType) -> Any:
    """Return a type as ``datasets.Features.to_dict`` does; lists as all versions read them."""
    import pyarrow as pa

    if pa.types.is_struct(kind):
        return {field.name: _feature(field.type) for field in kind}
    if pa.types.is_list(kind):
        return [_feature(kind.value_type)]
    return {
        "_type": "Value",
        "dtype": {"double": "float64", "float": "float32"}.get(str(kind), str(kind)),
    }


def _table(dataset: Dataset, samples: Iterable[Sample], schema: pa.Schema) -> pa.Table:
    import pyarrow as pa

    rows = []
    for sample in samples:
        row = json.loads(write_row(sample, dataset.header.dome_radius_mm))
        name = Path(row.pop("file_name")).name
        if "image" in schema.names:
            row["image"] = {"bytes": dataset.image_file(sample), "path": name}
        else:
            row["channels"] = dataset.signal(sample).ravel()
        if "extra" in row:
            row["extra"] = json.dumps(row["extra"], ensure_ascii=False)
        rows.append(row)
    return pa.Table.from_pylist(rows, schema=schema)
