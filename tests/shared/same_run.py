"""What two runs of the same work have in common, wherever and however often they were begun."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tactibench.records import Record

SAME = ("data", "test_frames", "weights", "weights_hash", "predictions_hash")


def in_common(record: Record | Mapping[str, Any]) -> dict[str, Any]:
    """Frames, weights and answers in the identity of a record."""
    values = record.json_values() if isinstance(record, Record) else record
    return {key: values["identity"][key] for key in SAME}
