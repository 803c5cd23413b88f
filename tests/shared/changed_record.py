"""Records in which some values are changed."""

from __future__ import annotations

import json
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


def listed_tables(text: str) -> dict[str, Any]:
    """Return the values of a record's text with its tables as lists of rows by name of the column.

    Such lists are a record, too, so that what was changed in them can be written back as JSON.
    """
    values: dict[str, Any] = json.loads(text)
    for name in ("metrics", "speed"):
        if isinstance(values[name], dict):
            columns, rows = values[name]["columns"], values[name]["data"]
            values[name] = [dict(zip(columns, row, strict=True)) for row in rows]
    return values
