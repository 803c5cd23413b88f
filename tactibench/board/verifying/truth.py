"""The truth of a submission's test frames, made again from the protocol and not from the record.

Presses are drawn from the protocol's seed (or a hidden one) on the sensor that the record names,
which must ship with tactibench; a simulated sensor reaches the poses that it is asked for. Recorded
frames are read from their folder. No model and no encoder is imported.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tactibench.contacts import Answer, FloatArray
from tactibench.errors import UserError
from tactibench.frames.drawn import frames_of_test, presser_of_test
from tactibench.frames.presser import Presser
from tactibench.frames.recorded import recorded_frames
from tactibench.frames.source import Wanted
from tactibench.frames.transfer import Target, open_target
from tactibench.geometry import true_contacts
from tactibench.plugins.base import SensorContext
from tactibench.plugins.discovery import installed
from tactibench.plugins.host import PluginHost
from tactibench.protocols.hidden_seed import HiddenSeed
from tactibench.protocols.loader import LoadedProtocol
from tactibench.protocols.schema import Protocol
from tactibench.records.record import Record
from tactibench.records.store import Arrays
from tactibench.run.components import Sensors, sensors_of
from tactibench.run.few_shot import Shots
from tactibench.run.published_predictions import find_released, released_arrays
from tactibench.run.request import HIDDEN, RunRequest, TestedOn, read_tested
from tactibench.run.test_sensor import with_test_sensor
from tactibench.run.transfer import with_target
from tactibench.run.truth import true_answers, truth_arrays

OURS = "tactibench"
"""The distribution whose plugins are trusted."""


@dataclass(frozen=True)
class Source:
    """What the truth may be made from. data: folder of recorded frames. cache: of frames."""

    host: PluginHost
    cache: Path
    data: Path | None = None


def trusted_host() -> PluginHost:
    """The plugins that ship with tactibench, and no others, whatever is installed."""
    return PluginHost([found for found in installed() if found[1].distribution == OURS])


def truth_of(
    record: Record, protocol: LoadedProtocol, source: Source, hidden: HiddenSeed | None
) -> Arrays:
    """Packed answers with press and group of every frame, and the bounds that the metrics need.

    Raises UserError where it cannot be made here.
    """
    if protocol.keys.transfer is not None:
        return _transferred(record, protocol, source)
    request = _request(record, source)
    sensors = with_test_sensor(request, _sensors(record, request, source.host), source.host)
    if sensors.sensor.spec.needs_data:
        return _recorded(request, protocol, sensors)
    if protocol.keys.split is None:
        raise UserError(
            f"{record.name}: sensor {sensors.sensor.name!r} has no recorded folder, which "
            f"protocol {protocol.keys.id!r} asks for."
        )
    tester = presser_of_test(protocol.keys, sensors, source.cache, hidden)
    wanted, _ = frames_of_test(request, tester, protocol.keys.split)
    radius = tester.pressed.workspace.dome_radius_mm
    truth = [true_contacts(scene, radius) for one in wanted for scene in one.scenes]
    arrays = _arrays(protocol.keys, wanted, truth)
    if "rmse_over_bound" in protocol.keys.metrics.names:
        arrays |= _bounds(tester, wanted)
    return arrays


def shots_of(record: Record, protocol: LoadedProtocol) -> Shots:
    """How often every test frame was answered, after how many labelled frames. Raises UserError."""
    transfer = protocol.keys.transfer
    if transfer is None:
        return Shots()
    seen = record.data.of_tested_sensor
    stated = None if seen is None else seen.labelled_frames
    for counts in ((0,), transfer.shots):
        if stated == list(counts):
            return Shots(counts)
    raise UserError(
        f"{record.name} says that its model was shown {stated} labelled frames of the tested "
        f"sensor; protocol {protocol.keys.id!r} shows none or {list(transfer.shots)} of them."
    )


def _transferred(record: Record, protocol: LoadedProtocol, source: Source) -> Arrays:
    """The truth of the recording that was tested, which --data names."""
    request, keys = _request(record, source), protocol.keys
    if request.tested.data is None:
        raise UserError(
            f"{record.name}: the truth of {keys.id!r} is in the recording that was tested, not "
            "in the one trained on; name the folder of the tested one with --data DIR."
        )
    shots = shots_of(record, protocol)
    sensors = with_target(request, protocol, _sensors(record, request, source.host), source.host)
    presser = None
    if not sensors.sensor.spec.needs_data:
        presser = Presser(keys, sensors.sensor, sensors.build_sensor, source.cache)
    target = open_target(keys, sensors, request.tested.data, presser)
    _same_recording(record, target, request.tested.data)
    wanted = target.want(None)
    truth = true_answers(keys, [wanted.open(lambda _: None)])
    presses, groups = shots.repeated(wanted.clusters), shots.groups(wanted.groups)
    return truth_arrays(keys, shots.repeated(truth), presses, groups)


def _same_recording(record: Record, target: Target, folder: Path) -> None:
    """Raise UserError where the labels in the folder are not those that the run was tested on."""
    seen, test = record.data.of_tested_sensor, record.test_sensor
    stated = None if seen is None else seen.described.get("sha256")
    found = target.folder.identity["describe"].get("sha256")
    if stated is None or stated != found:
        raise UserError(
            f"{record.name} was tested on {'' if test is None else test.description}, which is "
            f"not the recording in {folder}; name its folder with --data DIR."
        )


def _request(record: Record, source: Source) -> RunRequest:
    test = record.test_sensor
    asked = TestedOn()
    if test is not None:
        texts = tuple(text for text in test.options if text != HIDDEN)
        asked = read_tested(texts, hidden=HIDDEN in test.options)
        if asked.data is not None:  # a record holds the folder's last names alone
            asked = replace(asked, data=source.data)
    return RunRequest(
        record.protocol.id,
        "",
        record.regime,
        data=source.data,
        tested=asked,
        presses=record.limits.presses,
    )


def _sensors(record: Record, request: RunRequest, host: PluginHost) -> Sensors:
    stated = record.sensor
    if stated.name not in host.sensors.specs:
        raise UserError(
            f"{record.name}: sensor {stated.name!r} does not ship with tactibench, so its "
            "presses cannot be made again here; only runs on sensors that do can be verified."
        )
    spec = host.sensors[stated.name]
    if spec.needs_data and request.data is None:
        raise UserError(
            f"{record.name}: the truth of {record.protocol.id!r} on sensor "
            f"{spec.name!r} is in the recording; name its folder with --data DIR."
        )
    return sensors_of(record, host)


def _recorded(request: RunRequest, protocol: LoadedProtocol, sensors: Sensors) -> Arrays:
    frames = recorded_frames(request, protocol, sensors)
    keys = protocol.keys
    opened = [one.open(lambda _: None) for one in frames.test]
    truth = true_answers(keys, opened)
    arrays = _arrays(keys, frames.test, truth)
    if frames.published:
        released = find_released(protocol, request.data, None)
        names = [name for presses in opened for name in presses.names]
        arrays |= released_arrays(released, protocol.test_frames, names, truth)
    return arrays


def _arrays(keys: Protocol, wanted: Sequence[Wanted], truth: Sequence[Answer]) -> Arrays:
    presses = [press for one in wanted for press in one.clusters]
    return truth_arrays(keys, truth, presses, [group for one in wanted for group in one.groups])


def _bounds(tester: Presser, wanted: Sequence[Wanted]) -> Arrays:
    """Cramer-Rao standard deviations of every scene; empty where the sensor knows none."""
    seed = np.random.SeedSequence(tester.keys.data_seed)
    with tester.build(SensorContext(seed)) as sensor:
        bounds: list[FloatArray] = []
        for scene in (scene for one in wanted for scene in one.scenes):
            bound = sensor.bound(scene)
            if bound is None:
                return {}
            bounds.append(bound)
    return {"bound": np.concatenate(bounds)}
