"""The plan of a run: its components, what is in the cache already, and its identity."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactibench.errors import UserError
from tactibench.frames import FramePlan, FrameRequest, FrameSet, frame_source
from tactibench.plugins import ModelContext, PluginHost
from tactibench.protocols import LoadedProtocol, Protocol, load_protocol
from tactibench.records import code_hash, digest, installed_versions
from tactibench.run.components import Components, cannot_adapt, resolve_components
from tactibench.run.machine import choose_device, fingerprint_hash, machine
from tactibench.run.request import RunRequest, data_folder
from tactibench.run.test_sensor import describe_target, resolve_test_sensor
from tactibench.run.weights import WeightsPlan, plan_weights

if TYPE_CHECKING:
    from tactibench.protocols import HiddenSeed
    from tactibench.run.published_predictions import PublishedPredictions

SHOWS_ONLY = frozenset(
    {"_shipped", "api.py", "board", "cli", "live", "report", "scaffold", "sweep", "testing"}
)
"""Folders of the core that cannot change a record: protocols have a hash of their own."""
MOST_SETS = 6
"""Most sets of frames that a plan names; of more sets it only tells the number."""


@dataclass(frozen=True)
class RunPlan:
    """Everything that is known about a run before a frame is made.

    Attributes:
        request: The request.
        protocol: The protocol.
        components: Model, sensors and encoder.
        device: "cpu" or "cuda".
        frames: Plan of the frames.
        weights: Plan of the weights.
        published: Published predictions that the run is compared with.
        hidden: The secret seed of the test presses; None where it is not used.
    """

    request: RunRequest
    protocol: LoadedProtocol
    components: Components
    device: str
    frames: FramePlan
    weights: WeightsPlan
    published: tuple[PublishedPredictions, ...] = ()
    hidden: HiddenSeed | None = None

    @property
    def spec(self) -> Protocol:
        """Return the validated protocol."""
        return self.protocol.spec

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Return everything that could change the record; its digest names the run."""
        encoder, frames = self.components.encoder, self.frames
        optional = {
            "tested": frames.test_identity,
            "hidden": self.hidden and self.hidden.commitment,
            "shots": frames.few_shot and frames.few_shot.key,
            "released": [table.identity for table in self.published if table.path is not None],
        }
        return {
            "protocol": f"{self.protocol.label} {self.protocol.hash}",
            "weights": digest(self.weights.identity),
            "encoder": None
            if encoder is None
            else {"name": encoder.name, "parameters": dict(encoder.values)},
            "sensor": frames.sensor_identity,
            **{name: value for name, value in optional.items() if value},
            "test_frames": [frame_set.key for frame_set in frames.test],
            "seed": self.request.seed,
            "quick": self.request.quick,
            "limit": self.request.limit,
            "presses": self.request.presses,
            "code": code_hash("tactibench", SHOWS_ONLY),
            "plugins": self.components.plugin_versions(),
            "versions": installed_versions("numpy", "scipy", "torch"),
            "machine": fingerprint_hash(machine()),
        }

    @property
    def name(self) -> str:
        """Return the name of the run in the store."""
        request = self.request
        stem = name_stem(
            self.spec.id,
            self.components.model.name,
            self.components.regime,
            request.seed,
            quick=request.quick,
            presses=request.presses,
            tested=request.test.texts,
        )
        return f"{stem}-{digest(self.identity)[:8]}"

    @property
    def predictions_file(self) -> Path:
        """Return the file of the predictions for the test frames in the cache."""
        cache = self.weights.folder.parents[1]
        return cache / "predictions" / f"{digest(self.identity)[:24]}.npz"

    def context(self) -> ModelContext:
        """Return the context in which the model is built."""
        pressed = self.frames.on_range(self.spec)
        return ModelContext(
            answer=self.spec.answer,
            grid=pressed.grid.grid(),
            max_depth=pressed.workspace.depth_max_mm,
            encoder=self.components.build_encoder(),
            device=self.device,
            checkpoints=self.weights.checkpoints,
            transfers=self.spec.transfer is not None,
        )


def name_stem(
    protocol: str,
    model: str,
    regime: str,
    seed: int,
    *,
    quick: bool = False,
    presses: int | None = None,
    tested: Sequence[str] = (),
) -> str:
    """Return the name of a run without the hash at its end.

    Args:
        protocol: Id of the protocol.
        model: Name of the model.
        regime: Name of the training regime.
        seed: Seed of the training.
        quick: Whether it is a quick run.
        presses: Number of presses that the model learns from; None for all.
        tested: Texts of ``--test``.
    """
    terms = [protocol, model, regime]
    if quick:
        terms.append("quick")
    if presses is not None:
        terms.append(f"n{presses}")
    if tested:
        options = "-".join(text.removeprefix("sensor.") for text in tested)
        terms.append(f"on-{re.sub(r'[^A-Za-z0-9.]+', '-', options)}")
    return "-".join([*terms, f"s{seed}"])


def make_plan(
    request: RunRequest,
    host: PluginHost,
    cache: Path,
    frame_plans: dict[str, FramePlan] | None = None,
) -> RunPlan:
    """Return the plan of a run for a request.

    Args:
        request: The request.
        host: The plugins.
        cache: Folder of frames and weights.
        frame_plans: Plans of frames of the same sweep, by a text of their request. Missing ones are
            added: many cells share their frames, and a plan of frames takes most of the time.

    Raises:
        UserError: Something in the request does not exist or does not fit.
    """
    protocol = load_protocol(request.protocol)
    spec, test = protocol.spec, request.test
    data_folder(request.data)
    components = resolve_components(request, spec, host)
    test_sensor = resolve_test_sensor(test, spec, components.sensor, host)
    components = replace(components, test_sensor=test_sensor)
    if test.shots and not components.adapts:
        raise cannot_adapt(components.model.label)
    hidden = None
    if test.hidden:
        from tactibench.protocols import committed_seed

        hidden = committed_seed(protocol)
    frames = _plan_frames(
        FrameRequest(
            protocol=protocol,
            regime=components.regime,
            sensor=components.sensor,
            test_sensor=components.test_sensor,
            cache=cache,
            data=request.data,
            test_data=test.data,
            reference=test.reference,
            hidden=hidden,
            quick=request.quick,
            limit=request.limit,
            presses=request.presses,
            shots=test.shots,
        ),
        {} if frame_plans is None else frame_plans,
    )
    _check_signals(components, frames, host)
    published = _published_predictions(request, protocol, frames)
    device = choose_device(request.device)
    weights = plan_weights(
        spec,
        components,
        seed=request.seed,
        training_key=frames.training_key(),
        device=device,
        cache=cache,
    )
    return RunPlan(request, protocol, components, device, frames, weights, published, hidden)


def _plan_frames(request: FrameRequest, known: dict[str, FramePlan]) -> FramePlan:
    """Return the plan of the frames, taken from the known plans or added to them."""
    fields = {name: value for name, value in vars(request).items() if name != "protocol"}
    key = f"{request.protocol.hash} {fields}"  # the hash covers everything in the file
    if key not in known:
        known[key] = frame_source(request).plan()
    return known[key]


def no_weights(plan: RunPlan, otherwise: str = "") -> UserError:
    """Return the error for a request whose weights are not in the cache.

    Args:
        plan: The plan of the request.
        otherwise: What else a user can do, such as ", or add --train".
    """
    request = plan.request
    return UserError(
        f"there are no trained weights of {plan.components.model.label} in the cache for this "
        f"request; make them with `tactibench run {request.protocol} --model {request.model} "
        f"--train-only` and the same options{otherwise}."
    )


def _check_signals(components: Components, frames: FramePlan, host: PluginHost) -> None:
    """Raise UserError where the model cannot read the signals of a sensor of the run."""
    model = components.model.spec
    for sensor, signal in zip((components.sensor, components.tested), frames.signals, strict=False):
        if signal not in model.reads:
            reads = " and ".join(model.reads)
            able = ", ".join(other.name for other in host.models if signal in other.reads)
            raise UserError(
                f"model {model.name!r} reads {reads} frames, but sensor "
                f"{sensor.name!r} gives {signal} frames; models that read {signal}: "
                f"{able or 'none'}."
            )


def _published_predictions(
    request: RunRequest, protocol: LoadedProtocol, frames: FramePlan
) -> tuple[PublishedPredictions, ...]:
    """Return the published predictions for the test frames of this run.

    Raises:
        UserError: A file is named, but the run is not tested on the published frames or the file is
            none that was published.
    """
    if frames.source.published:
        from tactibench.run.published_predictions import find_published

        return find_published(protocol, request.data, request.published)
    if request.published is not None:
        raise UserError(
            f"--published {request.published} holds answers to the published test frames, which "
            "this run is not tested on; leave it out, or run the whole protocol on their recording."
        )
    return ()


def plan_lines(plan: RunPlan, stored: bool, *, answered: bool = False) -> list[str]:
    """Return what will be generated, trained and taken from the cache, line by line.

    Args:
        plan: The plan of the run.
        stored: Whether the run is in the store and is only shown.
        answered: Whether its answers are in the store and are only scored.
    """
    if answered and not stored:
        return [f"plan: the answers of {plan.name} are in the store and are scored"]
    if stored:
        return [f"plan: {plan.name} is in the store and is shown as it is (--fresh runs it again)"]
    frames, model = plan.frames, plan.components.model.label
    train = "take the trained weights from the cache"
    if not plan.weights.cached:
        again = " from where it stopped" if plan.weights.begun else ""
        sets = _describe_sets(plan, (*frames.fit, *frames.validation))
        train = f"{sets}; train {model} on {plan.device}{again}"
    target = ""
    if plan.components.test_sensor is not None:
        target = f"on {describe_target(plan.components.test_sensor, plan.request.test)}: "
    lines = [
        f"plan: {plan.name}",
        f"  train: {train}",
        f"  test:  {target}{_describe_sets(plan, frames.test)}; predict, time, score",
        *(f"  against {predictions.describe()}" for predictions in plan.published),
    ]
    if plan.spec.transfer is not None:
        counts = ", ".join(map(str, plan.spec.transfer.shots))
        shots = f"  shots: {counts} labelled frames of the tested sensor"
        if frames.calibrated:
            shots += f"; {frames.calibrated} frames calibrated the simulator and are left out"
        lines.insert(2, shots)
    elif frames.few_shot is not None:
        lines.insert(2, f"  shots: {_describe_sets(plan, (frames.few_shot,))}, with labels")
    return lines


def _describe_sets(plan: RunPlan, sets: tuple[FrameSet, ...]) -> str:
    """Return a text such as "generate 3,600 frames (singles) on tactip-127; take 400 ..."."""
    counts_by_way: dict[str, dict[str, int]] = {}
    for frames in sets:
        trains = frames.role in {"fit", "validation"}
        sensor = plan.components.sensor if trains else plan.components.tested
        name = f"{frames.name}, validation" if frames.role == "validation" else frames.name
        total, missing = len(frames.scenes), frames.missing
        ways = {
            f"generate {{}} frames on {sensor.label}": missing,
            "take {} frames from the cache": total - missing,
        }
        if sensor.spec.needs_data:
            ways = {"read {} frames": total}
        for way, count in ways.items():
            if count:
                counts = counts_by_way.setdefault(way, {})
                counts[name] = counts.get(name, 0) + count
    return "; ".join(way.format(_describe_counts(c)) for way, c in counts_by_way.items())


def _describe_counts(counts: dict[str, int]) -> str:
    """Return a text such as "3,600 (singles) and 400 (singles, validation)".

    Of many sets it tells only their number.
    """
    if len(counts) > MOST_SETS:
        return f"{sum(counts.values()):,} ({len(counts)} sets)"
    return " and ".join(f"{count:,} ({name})" for name, count in counts.items())
