"""What lies in a folder, to compare folders by."""

from __future__ import annotations

from pathlib import Path

CLOCKED = ("dataset.json", "events.jsonl")
"""Files of a data set that say when it was made."""


def files(folder: Path, *, without: tuple[str, ...] = ()) -> dict[str, bytes]:
    """Path inside the folder -> content, of every file that is not called so."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in without
    }
