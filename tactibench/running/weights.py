"""Trained weights: found in the cache or trained, and never used when damaged."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactibench.contacts import Answer, Frame
from tactibench.plugins.interfaces import FitReport, Model, Progress
from tactibench.records.files import file_hash, locked, read_json, write_json
from tactibench.records.identity import code_hash, combined, digest
from tactibench.running.parts import Parts
from tactibench.running.request import RunRequest

TRAINING_STREAM = 1
MANIFEST = "manifest.json"
SHARED_CODE = ("tactibench.training", "tactibench.contacts", "tactibench.geometry", "tactibench.images")
"""Core modules whose source changes what a model learns."""


@dataclass(frozen=True)
class WeightsPlan:
    """Identity of trained weights and where they are kept."""

    identity: dict[str, Any]
    folder: Path
    checkpoints: Path

    @property
    def cached(self) -> bool:
        return (self.folder / MANIFEST).is_file()


@dataclass(frozen=True)
class Trained:
    """A trained model's weights: their hash, and how they came to be."""

    hash: str
    report: dict[str, Any]
    reused: bool


def plan_weights(
    request: RunRequest,
    parts: Parts,
    *,
    answer: str,
    grid: dict[str, Any],
    training_key: str,
    device: str,
    cache: Path,
) -> WeightsPlan:
    """Everything that determines the weights; equal identities share one training."""
    import torch

    identity = {
        "model": parts.model.name,
        "parameters": dict(parts.model.values),
        "code": combined([parts.model.code(), *(code_hash(name) for name in SHARED_CODE)]),
        "encoder": None
        if parts.encoder is None
        else {
            "name": parts.encoder.name,
            "parameters": parts.encode_values,
            "code": parts.encoder.code(),
        },
        "answer": answer,
        "grid": grid,
        "regime": parts.regime,
        "frames": training_key,
        "seed": request.seed,
        "device": device,
        "torch": torch.__version__,
        "numpy": np.__version__,
    }
    key = digest(identity)[:24]
    return WeightsPlan(identity, cache / "weights" / key, cache / "training" / key)


def trained_weights(
    plan: WeightsPlan,
    model: Model,
    examples: Callable[[str], tuple[Sequence[Frame], Sequence[Answer]]],
    progress: Progress,
) -> Trained:
    """Load the weights into ``model``, training it first when they are not there.

    examples: "fit" or "validation" -> frames and truth, asked for only when training is needed.
    """
    with locked(plan.folder.with_name(plan.folder.name + ".lock")):
        manifest = _intact(plan)
        if manifest is None:
            manifest = _train(plan, model, examples, progress)
            return Trained(manifest["hash"], manifest["report"], False)
    model.load(plan.folder)
    return Trained(manifest["hash"], manifest["report"], True)


def _intact(plan: WeightsPlan) -> dict[str, Any] | None:
    """The manifest, when every file is what it was when it was written."""
    if not plan.cached:
        return None
    manifest: dict[str, Any] = read_json(plan.folder / MANIFEST)
    for name, value in manifest["files"].items():
        path = plan.folder / name
        if not path.is_file() or file_hash(path) != value:
            return None
    return manifest if manifest["identity"] == plan.identity else None


def _train(
    plan: WeightsPlan,
    model: Model,
    examples: Callable[[str], tuple[Sequence[Frame], Sequence[Answer]]],
    progress: Progress,
) -> dict[str, Any]:
    frames, truth = examples("fit")
    plan.checkpoints.mkdir(parents=True, exist_ok=True)
    seed = np.random.SeedSequence(plan.identity["seed"], spawn_key=(TRAINING_STREAM,))
    report: FitReport = model.fit(
        frames,
        truth,
        validation=examples("validation"),
        rng=np.random.default_rng(seed),
        progress=progress,
    )
    made = plan.folder.with_name(plan.folder.name + ".made")
    shutil.rmtree(made, ignore_errors=True)
    made.mkdir(parents=True)
    model.save(made)
    files = {
        path.relative_to(made).as_posix(): file_hash(path)
        for path in sorted(made.rglob("*"))
        if path.is_file()
    }
    manifest = {
        "identity": plan.identity,
        "files": files,
        "hash": combined([f"{name} {value}" for name, value in files.items()]),
        "report": asdict(report),
    }
    write_json(made / MANIFEST, manifest)
    shutil.rmtree(plan.folder, ignore_errors=True)
    made.rename(plan.folder)
    shutil.rmtree(plan.checkpoints, ignore_errors=True)
    return manifest
