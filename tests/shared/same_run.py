"""What two runs of the same work have in common, wherever and however often they were begun."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

SAME = ("data", "test_frames", "weights", "weights_hash", "predictions_hash")


def in_common(record: Mapping[str, Any]) -> dict[str, Any]:
    """Frames, weights and answers in the identity of a record."""
    return {key: record["identity"][key] for key in SAME}
