"""Samples cut into files of about equal size."""

from __future__ import annotations

from collections.abc import Sequence

MEGABYTE = 1_000_000
SHARD_BYTES = 500 * MEGABYTE
"""What Hugging Face cuts its own Parquet files to."""


def cut(sizes: Sequence[int], limit: int = SHARD_BYTES) -> list[range]:
    """Consecutive ranges whose sizes add up to at most ``limit`` bytes, or hold a single item.

    No item, no range.
    """
    shards: list[range] = []
    start, total = 0, 0
    for item, size in enumerate(sizes):
        if item > start and total + size > limit:
            shards.append(range(start, item))
            start, total = item, 0
        total += size
    if len(sizes):
        shards.append(range(start, len(sizes)))
    return shards
