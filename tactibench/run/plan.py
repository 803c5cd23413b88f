"""The plan of a run: what it is made of, what is there already, and its identity."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from tactibench.errors import UserError
from tactibench.frames.source import FramePlan, Wanted, plan_frames
from tactibench.plugins.base import ModelContext
from tactibench.plugins.host import PluginHost
from tactibench.protocols.hidden_seed import HiddenSeed, committed_seed
from tactibench.protocols.loader import LoadedProtocol, load_protocol
from tactibench.records.identity import code_hash, digest, installed_versions
from tactibench.run.components import Parts, data_folder, plugin_versions, resolve_parts
from tactibench.run.device import choose_device, machine
from tactibench.run.fingerprint import fingerprint_hash
from tactibench.run.published_predictions import Released, find_released
from tactibench.run.request import RunRequest
from tactibench.run.test_sensor import with_test_sensor, words
from tactibench.run.transfer import with_target
from tactibench.run.weights import WeightsPlan, plan_weights

SHOWS_ONLY = frozenset({"_shipped", "board", "cli", "report", "scaffold", "sweep", "testing"})
"""Folders of the core that cannot change a record: protocols have a hash of their own."""
MOST_SETS = 6
"""More sets of frames than these are counted in a plan, not named."""


@dataclass(frozen=True)
class RunPlan:
    """Everything that is known before a frame is made."""

    request: RunRequest
    protocol: LoadedProtocol
    parts: Parts
    device: str
    frames: FramePlan
    weights: WeightsPlan
    released: tuple[Released, ...] = ()
    hidden: HiddenSeed | None = None

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Whatever could change the record; its digest names the run."""
        encoder, tested = self.parts.encoder, self.frames.tested_identity
        return {
            "protocol": f"{self.protocol.label} {self.protocol.hash}",
            "weights": digest(self.weights.identity),
            "encoder": None
            if encoder is None
            else {"name": encoder.name, "parameters": dict(encoder.values)},
            "sensor": self.frames.sensor_identity,
            **({} if tested is None else {"tested": tested}),
            **({} if self.hidden is None else {"hidden": self.hidden.commitment}),
            "test_frames": [wanted.key for wanted in self.frames.test],
            **({} if self.frames.shots is None else {"shots": self.frames.shots.key}),
            **self._against(),
            "seed": self.request.seed,
            "quick": self.request.quick,
            "limit": self.request.limit,
            "presses": self.request.presses,
            "code": code_hash("tactibench", SHOWS_ONLY),
            "plugins": plugin_versions(self.parts),
            "versions": installed_versions("numpy", "scipy", "torch"),
            "machine": fingerprint_hash(machine()),
        }

    @property
    def name(self) -> str:
        """Name of the run in the store."""
        parts = [self.protocol.keys.id, self.parts.model.name, self.parts.regime]
        if self.request.quick:
            parts.append("quick")
        if self.request.presses is not None:
            parts.append(f"n{self.request.presses}")
        if self.request.tested:
            asked = (text.removeprefix("sensor.") for text in self.request.tested.texts)
            parts.append(f"on-{re.sub(r'[^A-Za-z0-9.]+', '-', '-'.join(asked))}")
        return "-".join([*parts, f"s{self.request.seed}", digest(self.identity)[:8]])

    def _against(self) -> dict[str, Any]:
        found = [one.identity for one in self.released if one.path is not None]
        return {"released": found} if found else {}

    @property
    def answers_file(self) -> Path:
        """Where the model's answers to the test frames are kept in the cache."""
        return self.weights.folder.parents[1] / "answers" / f"{digest(self.identity)[:24]}.npz"

    def context(self) -> ModelContext:
        keys = self.protocol.keys
        return ModelContext(
            answer=keys.answer,
            grid=keys.grid.grid(),
            max_depth=keys.workspace.depth_max_mm,
            encoder=self.parts.build_encoder(),
            device=self.device,
            checkpoints=self.weights.checkpoints,
            transfers=keys.transfer is not None,
        )


def make_plan(request: RunRequest, host: PluginHost, cache: Path) -> RunPlan:
    """Resolve a request. Raises UserError for anything that does not exist or fit."""
    protocol = load_protocol(request.protocol)
    data_folder(request.data)
    parts = resolve_parts(request, protocol, host)
    if protocol.keys.transfer is None:
        parts = with_test_sensor(request, parts, host)
    else:
        parts = with_target(request, protocol, parts, host)
    hidden = committed_seed(protocol) if request.tested.hidden else None
    frames = plan_frames(request, protocol, parts, cache, hidden)
    released = _released(request, protocol, frames)
    device = choose_device(request.device)
    weights = plan_weights(
        protocol.keys,
        parts,
        seed=request.seed,
        training_key=frames.training_key(),
        device=device,
        cache=cache,
    )
    return RunPlan(request, protocol, parts, device, frames, weights, released, hidden)


def _released(
    request: RunRequest, protocol: LoadedProtocol, frames: FramePlan
) -> tuple[Released, ...]:
    """Published answers to the very test frames of this run; others cannot be compared."""
    if frames.published:
        return find_released(protocol, request.data, request.released)
    if request.released is not None:
        raise UserError(
            f"--published {request.released} holds answers to the published test frames, which "
            "this run is not tested on; leave it out, or run the whole protocol on their recording."
        )
    return ()


def plan_lines(plan: RunPlan, stored: bool) -> list[str]:
    """What will be generated, trained and taken from the cache, in plain words."""
    if stored:
        return [f"plan: {plan.name} is in the store and is shown as it is (--fresh runs it again)"]
    train = "take the trained weights from the cache"
    if not plan.weights.cached:
        frames = _frames(plan, (*plan.frames.fit, *plan.frames.validation))
        again = " from where it stopped" if plan.weights.begun else ""
        train = f"{frames}; train {plan.parts.model.label()} on {plan.device}{again}"
    return [
        f"plan: {plan.name}",
        f"  train: {train}",
        *_shots(plan),
        f"  test:  {_tested(plan)}{_frames(plan, plan.frames.test)}; predict, time, score",
        *(f"  against {one.words()}" for one in plan.released),
    ]


def _shots(plan: RunPlan) -> list[str]:
    transfer = plan.protocol.keys.transfer
    if transfer is None or plan.frames.shots is None:
        return []
    counts = ", ".join(f"{count}" for count in transfer.shots)
    left = f"; {plan.frames.calibrated} frames calibrated the simulator and are left out"
    return [
        f"  shots: {counts} labelled frames of the tested sensor"
        + (left if plan.frames.calibrated else "")
    ]


def _tested(plan: RunPlan) -> str:
    if plan.parts.tested is None:
        return ""
    return f"on {words(plan.parts, plan.request.tested)}: "


def _frames(plan: RunPlan, wanted: tuple[Wanted, ...]) -> str:
    """``generate 3,600 (singles); take 400 (singles, validation) from the cache``."""
    ways: dict[str, dict[str, int]] = {}
    for one in wanted:
        sensor = plan.parts.test_sensor if one.role == "test" else plan.parts.sensor
        what = f"{one.name}, validation" if one.role == "validation" else one.name
        if sensor.spec.needs_data:
            way = "read {} frames"
        elif one.cached:
            way = "take {} frames from the cache"
        else:
            way = f"generate {{}} frames on {sensor.label()}"
        sets = ways.setdefault(way, {})
        sets[what] = sets.get(what, 0) + len(one.scenes)
    return "; ".join(way.format(_sets(sets)) for way, sets in ways.items())


def _sets(counted: dict[str, int]) -> str:
    """``3,600 (singles) and 400 (singles, validation)``; of many sets how many there are."""
    if len(counted) > MOST_SETS:
        return f"{sum(counted.values()):,} ({len(counted)} sets)"
    return " and ".join(f"{count:,} ({what})" for what, count in counted.items())
