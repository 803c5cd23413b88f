"""What trained weights the cache holds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactibench.errors import UserError
from tactibench.records.files import read_json
from tactibench.run.weights import MANIFEST


@dataclass(frozen=True)
class KeptWeights:
    """Weights in the cache. presses: they learned from, None where it was not noted; bytes: of all
    their files."""

    folder: Path
    model: str
    parameters: Mapping[str, Any]
    encoder: str | None
    regime: str
    seed: int
    device: str
    presses: int | None
    epochs: int
    seconds: float
    bytes: int
    hash: str


def kept_weights(cache: Path) -> list[KeptWeights]:
    """All readable ones, by model, regime, presses and seed."""
    found = [
        kept for path in sorted((cache / "weights").glob(f"*/{MANIFEST}")) for kept in _read(path)
    ]
    return sorted(
        found,
        key=lambda kept: (kept.model, kept.regime, kept.presses or 0, kept.seed, kept.folder.name),
    )


def _read(path: Path) -> Iterator[KeptWeights]:
    """One, or nothing where the manifest is damaged: a run would train anew."""
    try:
        manifest = read_json(path)
        identity, report = manifest["identity"], manifest["report"]
        encoder = identity["encoder"]
        yield KeptWeights(
            path.parent,
            identity["model"],
            identity["parameters"],
            None if encoder is None else encoder["name"],
            identity["regime"],
            identity["seed"],
            identity["device"],
            manifest.get("presses"),
            report["epochs"],
            report["seconds"],
            sum((path.parent / name).stat().st_size for name in manifest["files"]),
            manifest["hash"],
        )
    except (UserError, OSError, KeyError, TypeError):
        return
