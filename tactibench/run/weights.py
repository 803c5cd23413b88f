"""Trained weights: they are taken from the cache or trained, and never used when damaged."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from tactibench.contacts import Answer, Frame
from tactibench.errors import UserError
from tactibench.plugins import PRIORS, FitReport, Model, ModelSpec, Progress
from tactibench.protocols import Protocol
from tactibench.records import (
    BoundSpec,
    canonical,
    code_hash,
    combined,
    digest,
    file_hash,
    installed_versions,
    locked,
    read_checked_json,
    write_checked_json,
)
from tactibench.run.components import Components
from tactibench.training import resolve_precision

TRAINING_STREAM = 1
MANIFEST = "manifest.json"
SHARED_CODE = (
    "tactibench.contacts",
    "tactibench.frames.presses",
    "tactibench.geometry",
    "tactibench.images",
    "tactibench.training",
)
"""Core modules whose source changes what every model learns."""
PIN_CODE = ("tactibench.markers", "tactibench.superposition")
"""Core modules whose source also changes what models of pins, and models with contact mixing,
learn."""

TRAINED_WITH = ("torch", "numpy")
"""Distributions whose versions change weights."""

Examples = tuple[Sequence[Frame], Sequence[Answer]]


@dataclass(frozen=True)
class WeightsPlan:
    """Identity of trained weights and their place.

    Attributes:
        identity: Everything that determines the weights.
        folder: Folder of the weights in the cache.
        checkpoints: Folder of the checkpoints of their training.
    """

    identity: dict[str, Any]
    folder: Path
    checkpoints: Path

    @classmethod
    def of(cls, identity: dict[str, Any], cache: Path) -> Self:
        """Return the plan of an identity in a cache."""
        key = digest(identity)[:24]
        return cls(identity, cache / "weights" / key, cache / "training" / key)

    @property
    def cached(self) -> bool:
        """Return whether the weights are in the cache (they are verified when they are loaded)."""
        return (self.folder / MANIFEST).is_file()

    @property
    def begun(self) -> bool:
        """Return whether an interrupted training can be continued."""
        return self.checkpoints.is_dir() and any(self.checkpoints.iterdir())


@dataclass(frozen=True)
class TrainedWeights:
    """The weights of a trained model.

    Attributes:
        hash: Hash of the weights.
        report: Report of their training.
        reused: Whether they were in the cache.
    """

    hash: str
    report: dict[str, Any]
    reused: bool


def plan_weights(
    protocol: Protocol,
    components: Components,
    *,
    seed: int,
    training_key: str,
    device: str,
    cache: Path,
) -> WeightsPlan:
    """Return the plan of the weights; equal identities share one training.

    Args:
        protocol: The protocol of the run.
        components: Model, sensors and encoder of the run.
        seed: Seed of the training.
        training_key: Key of the training and validation frames.
        device: "cpu" or "cuda".
        cache: Folder of the cache.
    """
    model, encoder = components.model, components.encoder
    identity = {
        "model": model.name,
        "parameters": dict(model.values),
        "code": training_code(model),
        "encoder": None
        if encoder is None
        else {
            "name": encoder.name,
            "parameters": components.training_values,
            "code": encoder.code(),
        },
        "answer": protocol.answer,
        **({} if protocol.transfer is None else {"transfers": True}),
        "grid": protocol.grid.model_dump(),
        "dome_radius_mm": protocol.workspace.dome_radius_mm,
        "max_depth_mm": protocol.workspace.depth_max_mm,
        "regime": components.regime,
        "frames": training_key,
        "seed": seed,
        "device": device,
        **_auto_precision(model, device),
        "versions": installed_versions(*TRAINED_WITH),
    }
    return WeightsPlan.of(identity, cache)


def _auto_precision(model: BoundSpec[ModelSpec], device: str) -> dict[str, str]:
    """Return what precision "auto" is on this machine; {} where it cannot affect the training."""
    if model.values.get("precision") not in ("auto", "recipe"):
        return {}
    return {"auto_precision": resolve_precision("auto", device)}


def training_code(model: BoundSpec[ModelSpec]) -> str:
    """Return the hash of all source that changes what a model learns."""
    core: tuple[str, ...] = SHARED_CODE
    if model.values.get("mixing") or model.mentions(*PIN_CODE):
        core = (*SHARED_CODE, *PIN_CODE)
    return combined([model.code(), *(code_hash(name) for name in core)])


def trained_weights(
    plan: WeightsPlan,
    model: Model,
    examples: Callable[[str], Examples],
    progress: Progress,
) -> TrainedWeights:
    """Load weights into a model, after its training where they are not in the cache.

    Predictions are always made with weights that were read from the disk.

    Args:
        plan: Identity and place of the weights.
        model: The model, which is trained if necessary and loads the weights.
        examples: Function that returns frames and truth of "fit" or "validation". It is called only
            when they are needed.
        progress: Is told of every step.

    Raises:
        UserError: The report of the training cannot be recorded.
    """
    with locked(plan.folder.with_name(plan.folder.name + ".lock")):
        manifest = intact_manifest(plan)
        reused = manifest is not None
        if manifest is None:
            manifest = _train(plan, model, examples, progress)
        shutil.rmtree(plan.checkpoints, ignore_errors=True)
        model.load(plan.folder)
    return TrainedWeights(manifest["hash"], manifest["report"], reused)


def intact_manifest(plan: WeightsPlan) -> dict[str, Any] | None:
    """Return the manifest; None where it or a file has changed since it was written."""
    try:
        manifest: dict[str, Any] = read_checked_json(plan.folder / MANIFEST)
        files = manifest["files"]
        intact = (
            canonical(manifest["identity"]) == canonical(plan.identity)
            and manifest["hash"] == weights_hash(files)
            and "report" in manifest
            and all(file_hash(plan.folder / name) == value for name, value in files.items())
        )
    except (UserError, OSError, KeyError, TypeError, AttributeError, ValueError):
        return None
    return manifest if intact else None


def _train(
    plan: WeightsPlan,
    model: Model,
    examples: Callable[[str], Examples],
    progress: Progress,
) -> dict[str, Any]:
    frames, truth = examples("fit")
    plan.checkpoints.mkdir(parents=True, exist_ok=True)
    seed = np.random.SeedSequence(plan.identity["seed"], spawn_key=(TRAINING_STREAM,))
    report: object = model.fit(
        frames,
        truth,
        validation=examples("validation"),
        rng=np.random.default_rng(seed),
        progress=progress,
    )
    temporary = plan.folder.with_name(plan.folder.name + ".made")
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir(parents=True)
    model.save(temporary)
    files = {
        path.relative_to(temporary).as_posix(): file_hash(path)
        for path in sorted(temporary.rglob("*"))
        if path.is_file()
    }
    manifest = {
        "identity": plan.identity,
        "files": files,
        "hash": weights_hash(files),
        "report": _report_as_json(report, plan.identity["model"]),
        "presses": len(frames),
    }
    write_checked_json(temporary / MANIFEST, manifest)
    if plan.folder.exists():  # damaged
        shutil.rmtree(plan.folder)
    temporary.rename(plan.folder)
    return manifest


def weights_hash(files: Mapping[str, str]) -> str:
    """Return the hash of weights from the sha256 of every file, by name."""
    return combined([f"{name} {value}" for name, value in sorted(files.items())])


def _report_as_json(report: object, model: str) -> dict[str, Any]:
    """Return the report of a training as JSON values, with numpy's numbers as Python's.

    Raises:
        UserError: It is no FitReport, has an unknown prior, or holds a value that JSON cannot
            store.
    """
    if not isinstance(report, FitReport):
        raise UserError(
            f"fit of model {model!r} gave {type(report).__name__} where a FitReport is asked; end "
            "it with `return FitReport(...)`."
        )
    if report.prior is not None and report.prior not in PRIORS:
        raise UserError(
            f"fit of model {model!r} gave a FitReport with prior {report.prior!r}; allowed: "
            f"{', '.join(PRIORS)}."
        )
    try:
        text = json.dumps(asdict(report), allow_nan=False, default=lambda value: value.item())
    except (ValueError, TypeError, AttributeError) as error:
        raise UserError(
            f"model {model!r} reported a training that cannot be recorded ({error}): its loss was "
            "not finite, or a note is no number or text; train with other parameters or fix it."
        ) from None
    plain: dict[str, Any] = json.loads(text)
    return plain
