"""The plan of a run: what it is made of, what is there already, and its identity."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from tactibench.errors import UserError
from tactibench.plugins.host import PluginHost
from tactibench.plugins.interfaces import ModelContext
from tactibench.protocols.loader import LoadedProtocol, load_protocol
from tactibench.records.identity import code_hash, digest
from tactibench.running.frames import FramePlan, plan_frames
from tactibench.running.parts import Parts, data_folder, plugin_versions, resolve_parts
from tactibench.running.request import RunRequest
from tactibench.running.weights import WeightsPlan, plan_weights
from tactibench.timing.fingerprint import fingerprint, fingerprint_hash


@dataclass(frozen=True)
class RunPlan:
    """Everything that is known before a frame is made."""

    request: RunRequest
    protocol: LoadedProtocol
    parts: Parts
    device: str
    frames: FramePlan
    weights: WeightsPlan

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Whatever could change the record; its digest names the run."""
        parts = self.parts
        return {
            "protocol": f"{self.protocol.label} {self.protocol.hash}",
            "weights": digest(self.weights.identity),
            "encoder": None if parts.encoder is None else dict(parts.encoder.values),
            "sensor": self.frames.sensor_identity,
            "test_frames": [wanted.key for wanted in self.frames.test],
            "seed": self.request.seed,
            "quick": self.request.quick,
            "limit": self.request.limit,
            "code": code_hash("tactibench"),
            "plugins": plugin_versions(parts),
            "machine": fingerprint_hash(fingerprint(with_torch=True)),
        }

    @property
    def name(self) -> str:
        """Name of the run in the store."""
        parts = [self.protocol.keys.id, self.parts.model.name, self.parts.regime]
        if self.request.quick:
            parts.append("quick")
        return "-".join([*parts, f"s{self.request.seed}", digest(self.identity)[:8]])

    def context(self) -> ModelContext:
        keys = self.protocol.keys
        return ModelContext(
            answer=keys.answer,
            grid=keys.grid.grid(),
            max_depth=keys.workspace.depth_max_mm,
            encoder=self.parts.build_encoder(),
            device=self.device,
            checkpoints=self.weights.checkpoints,
        )


def make_plan(request: RunRequest, host: PluginHost, cache: Path) -> RunPlan:
    """Resolve a request. Raises UserError for anything that does not exist or fit."""
    protocol = load_protocol(request.protocol)
    data_folder(request.data)
    parts = resolve_parts(request, protocol, host)
    frames = plan_frames(request, protocol, parts, cache)
    device = choose_device(request.device)
    keys = protocol.keys
    weights = plan_weights(
        request,
        parts,
        answer=keys.answer,
        grid=keys.grid.model_dump(),
        training_key=frames.training_key(),
        device=device,
        cache=cache,
    )
    return RunPlan(request, protocol, parts, device, frames, weights)


def choose_device(asked: str) -> str:
    """ "cpu" or "cuda". Raises UserError for a card that is not there."""
    import torch

    if asked == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    if asked == "cuda" and not torch.cuda.is_available():
        raise UserError("--device cuda was asked for, but torch finds no GPU; use --device cpu.")
    return asked


def plan_lines(plan: RunPlan, stored: bool) -> list[str]:
    """What will be generated, trained and taken from the cache, in plain words."""
    if stored:
        return [f"plan: {plan.name} is in the store and is shown as it is (--fresh runs it again)"]
    made, cached = [], []
    for wanted in plan.frames:
        text = f"{len(wanted.scenes):,} {wanted.role} frames"
        text += f" ({wanted.name})" if wanted.name != wanted.role else ""
        if plan.parts.sensor.spec.needs_data:  # type: ignore[union-attr]
            cached.append(f"read {text}")
        elif wanted.cached:
            cached.append(f"take {text} from the cache")
        elif plan.weights.cached and wanted.role != "test":
            continue
        else:
            made.append(f"generate {text} on {plan.parts.sensor.label()}")
    if plan.weights.cached:
        cached = [line for line in cached if "test" in line]
        cached.append("take the trained weights from the cache")
    else:
        resumes = " (continuing)" if any(plan.weights.checkpoints.glob("*")) else ""
        made.append(f"train {plan.parts.model.label()} on {plan.device}{resumes}")
    return ["plan: " + "; ".join([*made, *cached]) + "; predict, time, score"]
