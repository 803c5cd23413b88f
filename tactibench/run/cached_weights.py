"""The trained weights in the cache, for listings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactibench.errors import UserError
from tactibench.records import file_hash, read_checked_json
from tactibench.run.weights import MANIFEST, weights_hash


@dataclass(frozen=True)
class CachedWeights:
    """Weights in the cache.

    Attributes:
        folder: Folder of the weights.
        model: Name of the model.
        parameters: Values of its parameters.
        encoder: Name of the encoder; None where the model uses none.
        regime: Name of the training regime.
        seed: Seed of the training.
        device: Device of the training, "cpu" or "cuda".
        presses: Number of presses that they learned from; None where it was not recorded.
        epochs: Number of epochs of the training.
        seconds: Duration of the training, s.
        bytes: Size of all their files.
        hash: Hash of the weights.
    """

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


def cached_weights(cache: Path) -> list[CachedWeights]:
    """Return all readable weights, ordered by model, regime, presses and seed."""
    paths = sorted((cache / "weights").glob(f"*/{MANIFEST}"))
    weights = [readable for path in paths for readable in _read(path)]
    return sorted(weights, key=lambda w: (w.model, w.regime, w.presses or 0, w.seed, w.folder.name))


def _read(path: Path) -> Iterator[CachedWeights]:
    """Yield the weights of a manifest; nothing where it is damaged, as a run would train anew."""
    try:
        manifest = read_checked_json(path)
        identity, report = manifest["identity"], manifest["report"]
        encoder = identity["encoder"]
        yield CachedWeights(
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


def weights_folder(cache: Path, content_hash: str) -> Path | None:
    """Return the folder of the weights with a hash; None where no intact weights have it.

    Args:
        cache: Folder of the cache.
        content_hash: Hash of the weights. It is compared with every file.
    """
    for weights in cached_weights(cache):
        if weights.hash == content_hash:
            files = read_checked_json(weights.folder / MANIFEST)["files"]
            hashes = {name: file_hash(weights.folder / name) for name in files}
            if weights_hash(hashes) == content_hash:
                return weights.folder
    return None
