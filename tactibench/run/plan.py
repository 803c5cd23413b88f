"""The plan of a run: its components, what is in the cache already, and its identity."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactibench.errors import UserError
from tactibench.frames import FramePlan, FrameRequest, FrameSet, frame_source
from tactibench.plugins import Encoder, ModelContext, PluginHost, Prior
from tactibench.protocols import LoadedProtocol, Protocol, load_protocol
from tactibench.records import (
    STORE,
    code_hash,
    digest,
    installed_versions,
    readable_run,
    unscored_run,
)
from tactibench.run.components import (
    Components,
    check_depth,
    check_signals,
    describe_target,
    holds_several,
    resolve_components,
)
from tactibench.run.machine import choose_device, fingerprint_hash, machine
from tactibench.run.request import RunRequest
from tactibench.run.weights import WeightsEntry, model_identity, plan_weights
from tactibench.run.worker import SHIPPED, WorkerHost

if TYPE_CHECKING:
    from tactibench.protocols import HiddenSeed
    from tactibench.run.published_predictions import PublishedPredictions

SHOWS_ONLY = frozenset(
    {"_shipped", "api.py", "board", "cli", "live", "report", "scaffold", "sweep", "testing"}
)
"""Folders of the core that cannot change a record: protocols have a hash of their own."""
MOST_SETS = 6
"""Most sets of frames that a plan names; of more sets it only tells the number."""


@dataclass(frozen=True, repr=False)
class RunPlan:
    """Everything that is known about a run before a frame is made.

    Attributes:
        request: The request.
        protocol: The protocol.
        components: Model, sensors and encoder.
        device: "cpu" or "cuda".
        frames: Plan of the frames.
        weights: Place of the weights in the cache.
        store: Folder of the run store.
        published: Published predictions that the run is compared with.
        hidden: The secret seed of the test presses; None where it is not used.
    """

    request: RunRequest
    protocol: LoadedProtocol
    components: Components
    device: str
    frames: FramePlan
    weights: WeightsEntry
    store: Path = STORE
    published: tuple[PublishedPredictions, ...] = ()
    hidden: HiddenSeed | None = None

    def __repr__(self) -> str:
        return f"RunPlan({self.name})"  # it holds thousands of scenes

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
            "encoder": encoder and encoder.component.identity,
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
        request, tested = self.request, self.request.test.texts
        terms = [self.spec.id, self.components.model.name, self.components.regime]
        if request.quick:
            terms.append("quick")
        if request.presses is not None:
            terms.append(f"n{request.presses}")
        if tested:
            options = "-".join(text.removeprefix("sensor.") for text in tested)
            terms.append(f"on-{re.sub(r'[^A-Za-z0-9.]+', '-', options)}")
        return "-".join([*terms, f"s{request.seed}", digest(self.identity)[:8]])

    @property
    def stored(self) -> bool:
        """Return whether the run is in the store already and can be read."""
        return readable_run(self.store, self.name) is not None

    def context(self, *, encoder: bool = True) -> ModelContext:
        """Return the context in which the model is built, with its encoder where that is asked."""
        pressed = self.frames.source.on_range()
        return ModelContext(
            answer=self.spec.answer,
            grid=pressed.grid.grid(),
            max_depth=pressed.workspace.depth_max_mm,
            encoder=self.components.build_encoder() if encoder else None,
            device=self.device,
            checkpoints=self.weights.checkpoints,
            transfers=self.spec.transfer is not None,
        )

    def scoring_encoder(self) -> Encoder | None:
        """Return the encoder for floors of heatmaps; None where it may not see the truth."""
        encoder = self.components.encoder
        if self.request.in_worker and encoder and encoder.origin.distribution != SHIPPED:
            return None
        return self.components.build_encoder()

    def shipped_prior(self) -> Prior | None:
        """Return what a model that ships knows beforehand; None for any other model."""
        model, spec = self.components.model, self.spec
        if model.origin.distribution != SHIPPED:
            return None
        several = holds_several(spec, self.components.regime)
        return model.spec.prior(model.values, spec.answer, several=several)

    @property
    def unrefined(self) -> RunPlan | None:
        """Return the plan of the model that this one refines; None where it refines none."""
        model = self.components.model
        if not model.spec.refines(model.values):
            return None
        plain = replace(model, values=model.spec.unrefined(model.values))
        components = replace(self.components, model=plain)
        identity = {**self.weights.identity, **model_identity(plain)}
        return replace(self, components=components, weights=self.weights.beside(identity))

    def of_fold(self, fold: FramePlan) -> RunPlan:
        """Return the plan of a training on a fold of the frames, whose weights are its own."""
        identity = {**self.weights.identity, "frames": fold.training_key()}
        return replace(self, frames=fold, weights=self.weights.beside(identity))

    def remove_cached(self) -> None:
        """Remove the frames and weights of the plan from the cache, so that they are made anew."""
        few_shot = () if self.frames.few_shot is None else (self.frames.few_shot,)
        for frames in (*self.frames, *few_shot):
            frames.remove()
        for fold in self.frames.folds:
            self.of_fold(fold).weights.remove()
        if self.unrefined is not None:
            self.unrefined.weights.remove()
        self.weights.remove()

    def lines(self, *, fresh: bool = False) -> list[str]:
        """Return what will be generated, trained and taken from the cache, line by line.

        Args:
            fresh: Whether everything will be made anew.

        Raises:
            UserError: A metric of the protocol does not exist or does not fit its answers.
        """
        name = self.name
        if self.stored and not fresh:
            return [f"plan: {name} is in the store and is shown as it is (--fresh runs it again)"]
        from tactibench.metrics import check_metrics

        check_metrics(self.protocol)
        if not fresh and unscored_run(self.store, name) is not None:
            return [f"plan: the answers of {name} are in the store and are scored"]
        frames, model = self.frames, self.components.model.label
        train = "take the trained weights from the cache"
        if fresh or not self.weights.cached:
            again = " from where it stopped" if self.weights.begun and not fresh else ""
            sets = self._describe_sets((*frames.fit, *frames.validation), fresh)
            train = f"{sets}; train {model} on {self.device}{again}"
        target = ""
        if self.components.test_sensor is not None:
            target = f"on {describe_target(self.components.test_sensor, self.request.test)}: "
        lines = [f"plan: {name}", f"  train: {train}"]
        if self.spec.transfer is not None:
            counts = ", ".join(map(str, self.spec.transfer.shots))
            lines.append(f"  shots: {counts} labelled frames of the tested sensor")
            if frames.calibrated:
                lines[-1] += f"; {frames.calibrated} frames calibrated the simulator, are left out"
        elif frames.few_shot is not None:
            shots = self._describe_sets((frames.few_shot,), fresh)
            lines.append(f"  shots: {shots}, with labels")
        test = self._describe_sets(frames.test, fresh)
        lines.append(f"  test:  {target}{test}; predict, time, score")
        return [*lines, *(f"  against {table.describe()}" for table in self.published)]

    def _describe_sets(self, sets: tuple[FrameSet, ...], fresh: bool) -> str:
        """Return a text such as "generate 3,600 frames (singles) on tactip-127; take 400 ..."."""
        counts_by_way: dict[str, dict[str, int]] = {}
        for frames in sets:
            trains = frames.role in {"fit", "validation"}
            sensor = self.components.sensor if trains else self.components.tested
            name = f"{frames.name}, validation" if frames.role == "validation" else frames.name
            way = f"generate {{}} frames on {sensor.label}"
            if sensor.spec.needs_data:
                way = "read {} frames"
            elif frames.cached and not fresh:
                way = "take {} frames from the cache"
            counts = counts_by_way.setdefault(way, {})
            counts[name] = counts.get(name, 0) + len(frames.scenes)
        return "; ".join(way.format(_describe_counts(c)) for way, c in counts_by_way.items())


def make_plan(
    request: RunRequest,
    host: PluginHost,
    cache: Path,
    frame_plans: dict[str, FramePlan] | None = None,
    store: Path = STORE,
    hidden_hash: str | None = None,
) -> RunPlan:
    """Return the plan of a run for a request.

    Args:
        request: The request.
        host: The plugins.
        cache: Folder of frames and weights.
        frame_plans: Plans of frames of the same sweep, by a text of their request. Missing ones are
            added: many cells share their frames, and a plan of frames takes most of the time.
        store: Folder of the run store.
        hidden_hash: Hash of the hidden seed of the record whose run is made again; that seed may
            be revealed. None: a run on hidden presses takes a seed that nobody knows.

    Raises:
        UserError: Something in the request does not exist or does not fit.
    """
    protocol = load_protocol(request.protocol)
    spec, test = protocol.spec, request.test
    components = resolve_components(request, spec, host)
    hidden = None
    if test.hidden:
        from tactibench.protocols import committed_seed, recorded_seed

        hidden = recorded_seed(protocol, hidden_hash) if hidden_hash else committed_seed(protocol)
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
    check_signals(components, frames.signals, host)
    if not frames.knows_depth:
        check_depth(components, protocol, host)
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
    return RunPlan(request, protocol, components, device, frames, weights, store, published, hidden)


def plugin_host(request: RunRequest) -> PluginHost:
    """Return the plugins for a request; those that do not ship stay outside for a worker."""
    return WorkerHost(request.runner) if request.in_worker else PluginHost()


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


def _describe_counts(counts: dict[str, int]) -> str:
    """Return a text such as "3,600 (singles) and 400 (singles, validation)".

    Of many sets it tells only their number.
    """
    if len(counts) > MOST_SETS:
        return f"{sum(counts.values()):,} ({len(counts)} sets)"
    return " and ".join(f"{count:,} ({name})" for name, count in counts.items())
