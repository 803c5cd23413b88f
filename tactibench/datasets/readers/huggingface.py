"""Image folders of Hugging Face `datasets`: metadata.jsonl or metadata.csv with a file_name.

A table lies in the folder itself, or in each folder of a split (train, validation, test).
Nested objects become columns `outer.inner`; lists stay texts.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tactibench.datasets.readers.folder import FolderContent
from tactibench.datasets.readers.options import ImportOptions
from tactibench.datasets.readers.table import Table, read_table
from tactibench.datasets.splits import Split
from tactibench.errors import UserError
from tactibench.png import read_file

METADATA = ("metadata.jsonl", "metadata.csv")
NAME = "file_name"

_SUBSETS = {
    "train": "train",
    "training": "train",
    "validation": "validation",
    "val": "validation",
    "valid": "validation",
    "dev": "validation",
    "test": "test",
}
"""Names of folders that hold a subset."""


def metadata_files(folder: Path) -> list[Path]:
    """Return the tables of an image folder: its own, or those of the folders directly in it."""
    for places in ([folder], sorted(child for child in folder.iterdir() if child.is_dir())):
        files = [
            next((place / name for name in METADATA if (place / name).is_file()), None)
            for place in places
        ]
        if any(files):
            return [path for path in files if path]
    return []


def read_huggingface(folder: Path, options: ImportOptions) -> FolderContent:
    """Read the tables of an image folder.

    Raises:
        UserError: There is no table, or it cannot be read.
    """
    paths = [folder / options.table] if options.table else metadata_files(folder)
    if not paths:
        raise UserError(
            f"{folder} holds no {' or '.join(METADATA)}, nor does any folder directly in it; name "
            "another folder or another format."
        )
    name = options.column or NAME
    cells: dict[str, list[str]] = {}
    folders: dict[str, range] = {}
    files, count = [], 0
    for path in paths:
        data = read_file(path)
        files.append(data)
        table = _read_lines(path, data) if path.suffix == ".jsonl" else read_table(path, data)
        table.column(name)
        prefix = "" if path.parent == folder else f"{path.parent.name}/"
        for column in {*cells, *table.columns}:
            texts = list(table.cells[column]) if column in table.cells else [""] * len(table)
            if column == name:
                texts = [prefix + text for text in texts]
            cells[column] = cells.get(column, [""] * count) + texts
        if prefix:
            folders[path.parent.name] = range(count, count + len(table))
        count += len(table)
    table = Table(paths[0], {name: cells.pop(name), **dict(sorted(cells.items()))})
    return FolderContent(
        format="huggingface",
        generation=f"{paths[0].name}, {len(paths)} table{'s' if len(paths) > 1 else ''}",
        folder=folder,
        table=table,
        data=b"".join(files),
        name_column=name,
        frame_folders=(folder,),
        label_columns=None,
        rest_folder=folder,
        splits=_split_of_folders(folders),
    )


def _split_of_folders(folders: Mapping[str, Sequence[int]]) -> dict[str, Split]:
    """Return the split by folders that are all named after subsets; {} where they are not."""
    subsets = {_SUBSETS.get(name.lower(), ""): rows for name, rows in folders.items()}
    if not folders or "" in subsets or len(subsets) < len(folders):
        return {}
    return {"imported": Split.of(**subsets)}


def _read_lines(path: Path, data: bytes) -> Table:
    rows: list[dict[str, str]] = []
    # str.splitlines() would also split at U+2028 and others, which JSON allows inside of texts.
    for number, line in enumerate(data.decode("utf-8-sig", "replace").split("\n"), start=1):
        if not line.strip():
            continue
        try:
            value = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise UserError(f"{path} line {number} is no JSON: {error}; fix it.") from None
        if not isinstance(value, dict):
            raise UserError(f"{path} line {number} is no JSON object; fix it.")
        rows.append(dict(_flatten(value)))
    if not rows:
        raise UserError(f"{path} has no rows; it must list at least one frame.")
    columns = dict.fromkeys(column for row in rows for column in row)
    return Table(path, {column: [row.get(column, "") for row in rows] for column in columns})


def _flatten(value: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for key, item in value.items():
        if isinstance(item, dict):
            yield from _flatten(item, f"{prefix}{key}.")
        elif isinstance(item, str):
            yield prefix + key, item
        elif item is not None:
            yield prefix + key, json.dumps(item)
