"""Files that travel with the package: beside the code in a wheel, at the root of a checkout."""

from __future__ import annotations

from pathlib import Path

OWN_BOARD = Path("leaderboards")
"""Boards of the present folder, which are read in place of those that ship, and written to."""


def shipped_folder(name: str) -> Path:
    """Return a folder such as ``leaderboards/published``, as it is called in a checkout."""
    package = Path(__file__).resolve().parent
    inside = package / "_shipped" / name
    return inside if inside.is_dir() else package.parent / name


def default_board() -> Path:
    """Return the folder of the boards of the present folder, or of those that ship."""
    return OWN_BOARD if OWN_BOARD.is_dir() else shipped_folder("leaderboards")
