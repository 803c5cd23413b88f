"""Image folders of Hugging Face `datasets`: metadata.jsonl or metadata.csv with a file_name.

The table lies in the folder itself, or one in each folder of a split (train, validation, test).
Nested objects become columns `outer.inner`; lists stay texts.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tactibench.datasets.importing.assemble import Source
from tactibench.datasets.importing.options import ImportOptions
from tactibench.datasets.importing.table import Table, read_table
from tactibench.errors import UserError
from tactibench.png import read_file

METADATA = ("metadata.jsonl", "metadata.csv")
NAME = "file_name"


def tables_of(folder: Path) -> list[Path]:
    """The tables of an image folder: its own, or those of the folders directly in it."""
    for at in ([folder], sorted(child for child in folder.iterdir() if child.is_dir())):
        found = [next((f / n for n in METADATA if (f / n).is_file()), None) for f in at]
        if any(found):
            return [path for path in found if path]
    return []


def read_huggingface(folder: Path, options: ImportOptions) -> Source:
    """Read the tables of an image folder. Raises UserError."""
    paths = [folder / options.table] if options.table else tables_of(folder)
    name = options.column or NAME
    cells: dict[str, list[str]] = {}
    parts: dict[str, tuple[int, ...]] = {}
    blobs, count = [], 0
    for path in paths:
        data = read_file(path)
        blobs.append(data)
        table = _json_lines(path, data) if path.suffix == ".jsonl" else read_table(path, data)
        table.column(name)
        prefix = "" if path.parent == folder else f"{path.parent.name}/"
        for column in {*cells, *table.columns}:
            new = [""] * len(table) if column not in table.cells else list(table.cells[column])
            if column == name:
                new = [prefix + cell for cell in new]
            cells[column] = cells.get(column, [""] * count) + new
        if prefix:
            parts[path.parent.name] = tuple(range(count, count + len(table)))
        count += len(table)
    table = Table(paths[0], {name: cells.pop(name), **dict(sorted(cells.items()))})
    return Source(
        "huggingface",
        f"{paths[0].name}, {len(paths)} table{'s' if len(paths) > 1 else ''}",
        folder,
        table,
        b"".join(blobs),
        name,
        (folder,),
        None,
        folder,
        parts,
    )


def _json_lines(path: Path, data: bytes) -> Table:
    rows: list[dict[str, str]] = []
    for number, line in enumerate(data.decode("utf-8-sig", "replace").splitlines(), start=1):
        if not line.strip():
            continue
        try:
            value = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise UserError(f"{path} line {number} is no JSON: {error}; mend it.") from None
        if not isinstance(value, dict):
            raise UserError(f"{path} line {number} is no JSON object; mend it.")
        rows.append(dict(_flat(value)))
    if not rows:
        raise UserError(f"{path} has no rows; it must list at least one frame.")
    columns = dict.fromkeys(column for row in rows for column in row)
    return Table(path, {column: [row.get(column, "") for row in rows] for column in columns})


def _flat(value: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for key, item in value.items():
        if isinstance(item, dict):
            yield from _flat(item, f"{prefix}{key}.")
        elif isinstance(item, str):
            yield prefix + key, item
        elif item is not None:
            yield prefix + key, json.dumps(item)
