"""Files that travel with the package: beside the code in a wheel, at the root of a checkout."""

from __future__ import annotations

from pathlib import Path

_CHECKOUT = {
    "protocols": "protocols",
    "published": "leaderboards/published",
    "hidden": "leaderboards/hidden",
}


def shipped_folder(name: str) -> Path:
    """Return the folder of ``protocols``, ``published`` tables or hashes of ``hidden`` seeds."""
    package = Path(__file__).resolve().parent
    inside = package / "_shipped" / name
    return inside if inside.is_dir() else package.parent / _CHECKOUT[name]
