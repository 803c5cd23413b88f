"""The truth of a submission's test frames, made again from the protocol and not from the record.

Presses are drawn from the protocol's seed (or a hidden one) on the sensor that the record names,
which must ship with tactibench. A simulated sensor reaches every pose that is requested. Recorded
frames are read from their folder. No model and no encoder is imported.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from tactibench.board.derivation import Derived, derive, read_facts
from tactibench.contacts import Answer, FloatArray
from tactibench.errors import UserError
from tactibench.frames import (
    DrawnFrames,
    FrameRequest,
    FrameSet,
    FrameSource,
    TransferFrames,
    frame_source,
    sampled_limits,
    true_answers,
)
from tactibench.geometry import true_contacts
from tactibench.plugins import PluginHost, SensorSpec
from tactibench.protocols import HiddenSeed, LoadedProtocol, Protocol
from tactibench.records import Arrays, BoundSpec, Record, digest
from tactibench.run import (
    HIDDEN,
    LIMIT,
    TestOptions,
    count_groups,
    find_published,
    published_arrays,
    read_test_options,
    repeat,
    resolve_test_sensor,
    truth_arrays,
)

T = TypeVar("T")

MOST_KEPT = 16
"""Most test sets whose truth is kept: a pull request has one or two, and one takes a megabyte."""


@dataclass(frozen=True)
class Source:
    """The sources of the truth.

    Attributes:
        host: Plugins that are trusted.
        cache: Folder of frames.
        data: Folder of recorded frames.
        kept: Truths that were drawn, and facts about the sets of frames, by everything that
            determines them, so that a second submission on the same test set needs no new draw.
    """

    host: PluginHost
    cache: Path
    data: Path | None = None
    kept: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def keep(self, identity: Any, make: Callable[[], T]) -> T:
        """Return the value that is kept for an identity, or make and keep it.

        Args:
            identity: Everything that determines the value, as a JSON value.
            make: Makes the value.
        """
        key = digest(identity)
        if key not in self.kept:
            while len(self.kept) >= MOST_KEPT:
                del self.kept[next(iter(self.kept))]
            self.kept[key] = make()
        value: T = self.kept[key]
        return value


@dataclass(frozen=True)
class TestSet:
    """The test set of a record.

    Attributes:
        truth: Packed true answers with press and group, and the bounds that the metrics need.
        derived: Facts that a record must state of its test set, its training set and its sensors.
    """

    __test__ = False  # not a test case, whatever its name

    truth: Arrays
    derived: Derived


def make_test_set(
    record: Record, protocol: LoadedProtocol, source: Source, hidden: HiddenSeed | None
) -> TestSet:
    """Return the test set that a record names, made again.

    Args:
        record: Record of a run.
        protocol: Version of the protocol that it answers.
        source: Sources of the truth.
        hidden: Hidden seed of the test presses; None: the protocol's seed.

    Raises:
        UserError: The test set cannot be made on this machine, or the record does not agree with
            its own options.
    """
    options = _test_options(record, source)
    if protocol.spec.transfer is None and options.shots != record.shots:
        raise UserError(
            f"{record.name} says that its model was shown {record.shots:,} labelled presses of the "
            f"tested sensor, but its options ask for {options.shots:,}; submit the run again."
        )
    if protocol.spec.transfer is not None and options.data is None:
        raise UserError(
            f"{record.name}: the truth of {protocol.spec.id!r} is in the recording that was "
            "tested, not in the one trained on; name the folder of the tested one with --data DIR."
        )
    sensor = _sensor(record, source)
    tested = resolve_test_sensor(options, protocol.spec, sensor, source.host)
    request = FrameRequest(
        protocol=protocol,
        regime=record.regime,
        sensor=sensor,
        test_sensor=tested,
        cache=source.cache,
        data=source.data,
        test_data=options.data,
        reference=options.reference,
        hidden=hidden,
        presses=record.limits.presses,
        shots=options.shots,
    )
    identity = [
        protocol.hash,
        sensor.component.identity,
        tested and tested.component.identity,
        options.reference,
        hidden and hidden.commitment,
        str(source.data),
    ]
    frames = cache(lambda: frame_source(request))
    training = [record.regime, record.limits.presses, options.shots]
    facts = source.keep(["facts", *identity, *training], lambda: read_facts(frames()))
    counts = labelled_counts(record, protocol)
    if protocol.spec.transfer is not None:
        _check_same_recording(record, facts.target, request.test_data)
    limits = bool(record.metric(LIMIT, "all"))
    truth = source.keep(
        ["truth", *identity, limits, counts], lambda: _truth(frames(), counts, limits)
    )
    return TestSet(truth, derive(record, options, request, facts, truth, hidden))


def _truth(frames: FrameSource, counts: tuple[int, ...], limits: bool) -> Arrays:
    if isinstance(frames, TransferFrames):
        return _transfer_truth(frames, counts)
    if not isinstance(frames, DrawnFrames):
        return _recorded_truth(frames)
    truth = _drawn_truth(frames)
    return truth | _limits(frames) if limits else truth


def labelled_counts(record: Record, protocol: LoadedProtocol) -> tuple[int, ...]:
    """Return the numbers of labelled frames after which every test frame was answered.

    Returns:
        () where the protocol shows no labelled frames.

    Raises:
        UserError: The record states other numbers than the protocol shows.
    """
    transfer = protocol.spec.transfer
    if transfer is None:
        return ()
    seen = record.data.of_tested_sensor
    stated = None if seen is None else seen.labelled_frames
    for counts in ((0,), transfer.shots):
        if stated == list(counts):
            return counts
    raise UserError(
        f"{record.name} says that its model was shown {stated} labelled frames of the tested "
        f"sensor; protocol {protocol.spec.id!r} shows none or {list(transfer.shots)} of them."
    )


def _transfer_truth(frames: TransferFrames, counts: tuple[int, ...]) -> Arrays:
    """Return the truth of the recording that was tested, in the folder of ``--data``."""
    (test,) = frames.test_frames()
    truth = true_answers(frames.spec, [test.open(lambda _: None)])
    return truth_arrays(
        frames.spec.answer,
        repeat(truth, counts),
        repeat(test.clusters, counts),
        count_groups(len(truth), counts),
    )


def _check_same_recording(record: Record, target: Mapping[str, Any], folder: Path | None) -> None:
    """Raise UserError where the recording in the folder is not the one that was tested."""
    seen, test = record.data.of_tested_sensor, record.test_sensor
    stated = None if seen is None else seen.described.get("sha256")
    if stated is None or stated != target.get("sha256"):
        raise UserError(
            f"{record.name} was tested on {'' if test is None else test.description}, which is "
            f"not the recording in {folder}; name its folder with --data DIR."
        )


def _test_options(record: Record, source: Source) -> TestOptions:
    test = record.test_sensor
    if test is None:
        return TestOptions()
    texts = tuple(text for text in test.options if text != HIDDEN)
    options = read_test_options(texts, hidden=HIDDEN in test.options)
    # A record holds only the last two names of the folder's path.
    return options if options.data is None else replace(options, data=source.data)


def _sensor(record: Record, source: Source) -> BoundSpec[SensorSpec]:
    """Return the sensor that pressed the training scenes, with the settings of the record."""
    stated, sensors = record.sensor, source.host.sensors
    spec = sensors[stated.name]
    if spec.origin == "real" and not spec.needs_data:
        raise UserError(
            f"{record.name}: sensor {stated.name!r} presses for itself, and what it reached "
            "cannot be made again here; record its presses, and run on the recording."
        )
    if spec.needs_data and source.data is None:
        raise UserError(
            f"{record.name}: the truth of {record.protocol.id!r} on sensor "
            f"{stated.name!r} is in the recording; name its folder with --data DIR."
        )
    sensor: BoundSpec[SensorSpec] = BoundSpec.of_record(sensors, stated)
    return sensor


def _recorded_truth(frames: FrameSource) -> Arrays:
    sets = frames.test_frames()
    opened = [frame_set.open(lambda _: None) for frame_set in sets]
    truth = true_answers(frames.spec, opened)
    arrays = _pack_truth(frames.spec, sets, truth)
    if frames.published:
        protocol = frames.request.protocol
        published = find_published(protocol, frames.request.data, None)
        names = [name for presses in opened for name in presses.names]
        arrays |= published_arrays(published, protocol.test_frames, names, truth)
    return arrays


def _drawn_truth(frames: DrawnFrames) -> Arrays:
    """Return the truth of drawn scenes: a simulated sensor reaches every pose that is requested."""
    sets = frames.test_frames()
    scenes = [scene for frame_set in sets for scene in frame_set.scenes]
    radius = frames.testing.pressed.workspace.dome_radius_mm
    arrays = _pack_truth(frames.spec, sets, [true_contacts(scene, radius) for scene in scenes])
    if "rmse_over_bound" not in frames.spec.metrics.names:
        return arrays
    main = [scene for frame_set in sets if not frame_set.apart for scene in frame_set.scenes]
    bounds: list[FloatArray] = []
    with frames.testing.open(np.random.SeedSequence(frames.testing.protocol.data_seed)) as sensor:
        for scene in main:
            bound = sensor.bound(scene)
            if bound is None:
                return arrays
            bounds.append(bound)
    return {**arrays, "bound": np.concatenate(bounds)}


def _limits(frames: DrawnFrames) -> Arrays:
    """Return the two-point limits of the test presses; empty where the sensor does not know one."""
    limits = []
    with frames.testing.open(np.random.SeedSequence(frames.testing.protocol.data_seed)) as sensor:
        for frame_set in (candidate for candidate in frames.test_frames() if not candidate.apart):
            limit = sampled_limits(sensor, frame_set.scenes)
            if limit is None:
                return {}
            limits.append(limit)
    return {"limit": np.concatenate(limits)}


def _pack_truth(protocol: Protocol, sets: Sequence[FrameSet], truth: Sequence[Answer]) -> Arrays:
    clusters = [press for frame_set in sets for press in frame_set.clusters]
    groups = [group for frame_set in sets for group in frame_set.groups]
    return truth_arrays(protocol.answer, truth, clusters, groups)
