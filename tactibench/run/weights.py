"""Trained weights: they are taken from the cache or trained, and never used when damaged."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from contextlib import chdir
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactibench.contacts import Answer, Frame
from tactibench.errors import UserError
from tactibench.frames import FrameSet, true_answers
from tactibench.plugins import FitReport, Model, ModelSpec, Progress
from tactibench.protocols import Protocol
from tactibench.records import (
    MANIFEST,
    BoundSpec,
    CacheEntry,
    code_hash,
    combined,
    digest,
    installed_versions,
    read_checked_json,
)
from tactibench.run.components import Components
from tactibench.run.machine import limited_threads
from tactibench.run.reporter import Reporter, open_frames
from tactibench.run.worker import WorkerModel, train_by_command

if TYPE_CHECKING:
    from tactibench.run.plan import RunPlan

TRAINING_STREAM = 1
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


@dataclass(frozen=True)
class WeightsEntry(CacheEntry):
    """Trained weights in the cache."""

    @property
    def checkpoints(self) -> Path:
        """Return the folder of the checkpoints of the training."""
        return self.folder.parents[1] / "training" / self.folder.name

    @property
    def begun(self) -> bool:
        """Return whether an interrupted training can be continued."""
        return self.checkpoints.is_dir() and any(self.checkpoints.iterdir())

    def beside(self, identity: Mapping[str, Any]) -> WeightsEntry:
        """Return the place of weights of another identity in the same cache."""
        return WeightsEntry(self.folder.parent / digest(identity)[:24], dict(identity))

    def remove(self) -> None:
        """Remove the weights and the checkpoints, so that the model is trained anew."""
        super().remove()
        shutil.rmtree(self.checkpoints, ignore_errors=True)


@dataclass(frozen=True)
class TrainedWeights:
    """The weights of a trained model.

    Attributes:
        hash: Hash of the weights.
        report: Report of their training, see ``FitReport``.
        reused: Whether they were in the cache.
        folder: Folder of the weights.
    """

    hash: str
    report: dict[str, Any]
    reused: bool
    folder: Path


def plan_weights(
    protocol: Protocol,
    components: Components,
    *,
    seed: int,
    training_key: str,
    device: str,
    cache: Path,
) -> WeightsEntry:
    """Return the place of the weights; equal identities share one training.

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
        **model_identity(model),
        "encoder": encoder
        and {
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
        "versions": installed_versions("torch", "numpy"),
    }
    return WeightsEntry(cache / "weights" / digest(identity)[:24], identity)


def model_identity(model: BoundSpec[ModelSpec]) -> dict[str, Any]:
    """Return name, parameters, and the hash of all source that changes what a model learns."""
    core: tuple[str, ...] = SHARED_CODE
    pins = model.values.get("mixing") or model.spec.refines(model.values)
    if pins or model.mentions(*PIN_CODE):
        core = (*SHARED_CODE, *PIN_CODE)
    code = combined([model.code(), *(code_hash(name) for name in core)])
    return {"model": model.name, "parameters": dict(model.values), "code": code}


def train_model(
    plan: RunPlan, reporter: Reporter, *, fresh: bool = False
) -> tuple[Model, TrainedWeights]:
    """Return the model of a plan with its weights, trained where they are not in the cache.

    Interrupted training is continued by the same call. Predictions are always made with weights
    that were read from the disk. A model that refines another's contacts takes the weights of that
    model, so that a row with refinement and one without are of one training.

    Args:
        plan: The plan of the run.
        reporter: Shows the work.
        fresh: Whether to make frames and weights anew.

    Raises:
        UserError: The report of the training cannot be recorded.
    """
    if fresh:
        plan.remove_cached()
    if plan.request.in_worker:
        return _trained_apart(plan)
    model: Model = plan.components.model.build(plan.context())
    entry, unrefined = plan.weights, plan.unrefined
    refined = None
    if unrefined is not None and not entry.cached:
        refined = train_model(unrefined, reporter)
    with reporter.training() as progress, entry.locked():
        manifest = entry.read()
        reused = manifest is not None
        if manifest is None:
            manifest = _train(plan, model, reporter, progress, refined)
        shutil.rmtree(entry.checkpoints, ignore_errors=True)
        model.load(entry.folder)
    weights = weights_hash(manifest["files"])
    return model, TrainedWeights(weights, manifest["report"], reused, entry.folder)


def _trained_apart(plan: RunPlan) -> tuple[Model, TrainedWeights]:
    """Return the model of a plan for a worker, and its weights, trained by another process."""
    manifest = plan.weights.read()
    reused = manifest is not None
    if manifest is None:
        manifest = train_by_command(plan)
    model, folder = WorkerModel(plan), plan.weights.folder
    model.load(folder)
    return model, TrainedWeights(
        weights_hash(manifest["files"]), manifest["report"], reused, folder
    )


def _train(
    plan: RunPlan,
    model: Model,
    reporter: Reporter,
    progress: Progress,
    refined: tuple[Model, TrainedWeights] | None,
) -> dict[str, Any]:
    """Train a model on one thread, store its weights, and return their manifest.

    On more threads sums are taken in another order, and the weights would depend on their number.

    Args:
        plan: The plan of the run.
        model: The model, not yet trained.
        reporter: Shows how frames are made.
        progress: Shows the training.
        refined: The trained model whose contacts it refines; None where it refines none.
    """
    entry = plan.weights
    frames, truth = _examples(plan, plan.frames.fit, reporter)
    validation = _examples(plan, plan.frames.validation, reporter)
    if refined is not None:
        from tactibench.training import RefinedModel

        network, trained = refined
        model = RefinedModel(network)
        before = FitReport(**trained.report)
        with limited_threads(1):
            report: object = model.learn_fields(before, frames, truth, validation)
    else:
        entry.checkpoints.mkdir(parents=True, exist_ok=True)
        seed = np.random.SeedSequence(plan.request.seed, spawn_key=(TRAINING_STREAM,))
        rng = np.random.default_rng(seed)
        with chdir("."), limited_threads(1):  # a plugin may leave the folder
            report = model.fit(frames, truth, validation=validation, rng=rng, progress=progress)

    def fill(folder: Path) -> dict[str, Any]:
        model.save(folder)
        name = plan.components.model.name
        return {"report": _report_as_json(report, name), "presses": len(frames)}

    return entry.write(fill)


def _examples(
    plan: RunPlan, sets: Sequence[FrameSet], reporter: Reporter
) -> tuple[Sequence[Frame], Sequence[Answer]]:
    opened = [open_frames(frames, reporter) for frames in sets]
    frames = [frame for presses in opened for frame in presses.frames]
    return frames, true_answers(plan.spec, opened)


def weights_hash(files: Mapping[str, str]) -> str:
    """Return the hash of weights from the sha256 of every file, by name."""
    return combined([f"{name} {value}" for name, value in sorted(files.items())])


def _report_as_json(report: object, model: str) -> dict[str, Any]:
    """Return the report of a training as JSON values, with numpy's numbers as Python's.

    Raises:
        UserError: It is no FitReport, or holds a value that JSON cannot store.
    """
    if not isinstance(report, FitReport):
        raise UserError(
            f"fit of model {model!r} gave {type(report).__name__} where a FitReport is asked; end "
            "it with `return FitReport(...)`."
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


def cached_weights(cache: Path) -> list[dict[str, Any]]:
    """Return a row for all readable weights, ordered by model, regime, presses and seed.

    A row holds model, parameters, encoder ("none" where the model uses none), regime, presses,
    seed, device, epochs, training_s, bytes, hash and the folder's name.
    """
    rows = []
    for folder in (cache / "weights").glob("[!.]*/"):
        try:
            manifest = read_checked_json(folder / MANIFEST)
            identity, report = manifest["identity"], manifest["report"]
            names = ("model", "parameters", "regime", "seed", "device")
            row = {name: identity[name] for name in names} | {
                "encoder": (identity["encoder"] or {"name": "none"})["name"],
                "presses": manifest["presses"],
                "epochs": report["epochs"],
                "training_s": report["seconds"],
                "bytes": sum((folder / name).stat().st_size for name in manifest["files"]),
                "hash": weights_hash(manifest["files"]),
                "folder": folder.name,
            }
        except (UserError, OSError, KeyError, TypeError):
            continue  # damaged: a run would train anew
        rows.append(row)
    order = ("model", "regime", "presses", "seed", "folder")
    return sorted(rows, key=lambda row: [row[name] for name in order])
