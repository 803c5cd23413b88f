"""WebDataset: tar files in which ``000123.png`` and ``000123.json`` stand side by side.

Two exports of one data set are the same bytes: no time, no owner, samples in the order of ids.
"""

from __future__ import annotations

import io
import tarfile
from collections.abc import Callable
from pathlib import Path

from tactibench.datasets import Dataset
from tactibench.datasets.exporting.chosen import Chosen
from tactibench.datasets.exporting.cut import SHARD_BYTES, cut
from tactibench.datasets.exporting.frames import file_of, size_of
from tactibench.datasets.rows import write_row

_BLOCK = 512
"""A tar file is written in blocks, a header before every file."""


def write_webdataset(
    dataset: Dataset,
    folder: Path,
    chosen: Chosen,
    advance: Callable[[int], None],
    shard_bytes: int = SHARD_BYTES,
) -> None:
    """Write ``train-000000.tar`` ..., one series a part. The JSON is the sample's journal line."""
    for part, samples in chosen.parts.items():
        sizes = [size_of(dataset, s) + 4 * _BLOCK for s in samples]
        for number, shard in enumerate(cut(sizes, shard_bytes)):
            path = folder / f"{part}-{number:06d}.tar"
            with tarfile.open(path, "w", format=tarfile.USTAR_FORMAT) as tar:
                for sample in samples[shard.start : shard.stop]:
                    key = Path(sample.file_name).stem
                    _add(tar, f"{key}.png", file_of(dataset, sample))
                    _add(tar, f"{key}.json", write_row(sample, dataset.header.dome_radius_mm))
                    advance(1)


def _add(tar: tarfile.TarFile, name: str, data: bytes) -> None:
    """TarInfo's own values: time 0, owner 0 without a name, mode 644."""
    entry = tarfile.TarInfo(name)
    entry.size = len(data)
    tar.addfile(entry, io.BytesIO(data))
