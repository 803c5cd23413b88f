"""exp1, exp2 and exp3 with few presses, as protocols of one's own: few-exp1 and so on."""

from __future__ import annotations

import re
from pathlib import Path

from tactibench.protocols import protocol_files

NUMBERS = {
    "count = 5000": "count = 60",
    "count = 1000": "count = 20",
    "count = 120": "count = 4",
    "test = 1000": "test = 20",
    "validation = 400": "validation = 10",
    "per_distance = 100": "per_distance = 2",
    # Tests apart: an instance needs a press at least.
    "count = 400": "count = 16",
    "count = 240": "count = 8",
    "count = 200": "count = 4",
    "count = 160": "count = 8",
    "per_distance = 20": "per_distance = 1",
    "per_distance = 24": "per_distance = 2",
}


def few_presses(folder: Path, prefix: str = "few-") -> dict[str, Path]:
    """Write them and their boards into a new folder; name -> file. prefix: of their ids."""
    folder.mkdir()
    files = {name: folder / f"{prefix}{name}.toml" for name in ("exp1", "exp2", "exp3")}
    for name, path in files.items():
        shipped = protocol_files()[name]
        text = shipped.read_text(encoding="utf-8")
        text = text.replace(f'id = "{name}"', f'id = "{prefix}{name}"')
        board = shipped.with_suffix(".board.toml").read_text(encoding="utf-8")
        path.with_suffix(".board.toml").write_text(board, encoding="utf-8")
        for long, short in NUMBERS.items():
            text = re.sub(rf"^{long}\b", short, text, flags=re.MULTILINE)
        path.write_text(text, encoding="utf-8")
    return files
