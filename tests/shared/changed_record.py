"""A record in which some values were changed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tactibench.records import Record


def changed_record(record: Record, changes: Mapping[str, Any]) -> Record:
    """Return the record with other values, by the dotted names of their keys in its file."""
    values = record.json_values()
    for place, value in changes.items():
        *tables, key = place.split(".")
        table = values
        for name in tables:
            table = table.setdefault(name, {})
        table[key] = value
    return Record.model_validate(values)
