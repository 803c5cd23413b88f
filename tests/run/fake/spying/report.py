"""What was found is written beside the folder that the plugin is installed in."""

from __future__ import annotations

from pathlib import Path

FOUND = Path(__file__).parents[2] / "found"


def note(attack: str, found: bytes) -> None:
    """Add what an attack found to its file."""
    with (FOUND / attack).open("ab") as file:
        file.write(found + b"\n")
