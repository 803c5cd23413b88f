"""One submission, checked and scored again; a message names the first thing that is wrong.

The truth of the test frames is made again from the protocol and not from the record: presses are
drawn from the protocol's seed (or a hidden one) on the sensor that the record names. A simulated
sensor reaches every pose that is requested; recorded frames are read from their folder. No model
and no encoder is imported. Everything else that a record says is its submitter's word.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactibench.board.rows import BOUND, label_of, shipped_models
from tactibench.board.submissions import (
    Arrays,
    answers_file,
    check_answers,
    ranked_errors,
    read_answers_file,
    read_submission,
    refuse_names,
    split_ranked,
)
from tactibench.contacts import FloatArray
from tactibench.errors import UserError, describe_exception
from tactibench.frames import (
    DrawnFrames,
    FrameRequest,
    FrameSource,
    TransferFrames,
    frame_source,
    sampled_limits,
    true_answers,
)
from tactibench.geometry import true_contacts
from tactibench.plugins import PluginHost, SensorSpec
from tactibench.protocols import (
    HiddenSeed,
    LoadedProtocol,
    board_spec,
    recorded_seed,
    recorded_version,
)
from tactibench.records import (
    BoundSpec,
    Metric,
    Record,
    arrays_hash,
    digest,
    make_signature,
    measured_on,
)
from tactibench.run import (
    HIDDEN,
    LIMIT,
    SHIPPED,
    TestOptions,
    failures_record,
    few_shot_truth,
    find_published,
    published_arrays,
    read_test_options,
    resolve_test_sensor,
    score_arrays,
    truth_arrays,
)

TOLERANCE = 1e-6
"""Relative tolerance; another processor or version of numpy sums in another order."""
FROM_SENSOR = (BOUND, "std_over_bound", LIMIT)
"""Metrics of answers and of the noise of the sensor that the run had. A later version of a
simulator has another noise: they are the word of the record until somebody reproduces the row."""
NEGLIGIBLE_MM = 1e-6
"""Tolerance of the error of one press, which is near 0 where the truth is fitted to pins."""
FROM_MAPS = frozenset({"surface_rmse_mm", "surface_floor_mm", "surface_excess_mm"})
"""Metrics of heatmaps, which are not submitted."""
FORM = ("unit", "better", "censored", "method")
"""Fields of a metric that do not depend on what was measured."""


@dataclass(frozen=True)
class Source:
    """The sources of the truth.

    Attributes:
        host: The plugins.
        cache: Folder of frames.
        data: Folder of recorded frames.
        truths: Truths that were made, by everything that determines them, so that a second
            submission on the same test set needs no new draw.
    """

    host: PluginHost
    cache: Path
    data: Path | None = None
    truths: dict[str, Arrays] = field(default_factory=dict, repr=False, compare=False)


@dataclass(frozen=True)
class Verdict:
    """The verdict on a submission that was not refused.

    Attributes:
        path: File of the record.
        record: The record.
        frames: Number of test frames.
        again: Rows of metrics that were computed anew and equal the stated ones; of FROM_SENSOR
            they may differ.
    """

    path: Path
    record: Record
    frames: int
    again: tuple[Metric, ...]

    @property
    def subject(self) -> str:
        """Name, such as "unet + hertz (single), seed 0 on simulated sensor tactip-127"."""
        record = self.record
        return f"{label_of(record)}, seed {record.seed} on {measured_on(record)}"

    def headline(self) -> list[Metric]:
        """Return the error that orders the board, with missed and spurious contacts or coverage."""
        wanted = headline(self.record)
        return [row for row in self.again if (row.metric, row.group) in wanted]

    @property
    def checked(self) -> str:
        """What was checked, in words."""
        return (
            "the form of both files; that the answers are those of the record; "
            f"{len(self.again):,} metrics with their intervals and counts, against the truth of "
            f"{self.frames:,} test frames, which was made again; the errors by which a board ranks"
        )

    @property
    def unknown(self) -> str:
        """What these files cannot show, in words; a board shows it as submitted."""
        metrics = {row.metric for row in self.record.metrics}
        claims = [
            "that this model gave these answers",
            "its training and weights",
            "its times and the machine",
            *(["bounds of the sensor"] if metrics & {*FROM_SENSOR} else []),
            *(["metrics of heatmaps"] if metrics & FROM_MAPS else []),
        ]
        if self.record.model.name not in shipped_models():
            claims.append("what it knew of contacts that press together")
        return "; ".join(claims)


def headline(record: Record) -> list[tuple[str, str]]:
    """Return metric and group of the error that orders the board of a record, and of its misses."""
    ranking = board_spec(record.protocol.label).ranking
    first = [] if ranking is None else [(ranking.metric, ranking.group)]
    return [*first, *((name, "all") for name in ("missed", "spurious", "coverage"))]


def verify(path: Path, source: Source, *, folder: Path | None = None) -> Verdict:
    """Check and score one committed record. One file never stops the verification of others.

    Args:
        path: File of the record.
        source: Sources of the truth.
        folder: Folder of the published hashes of hidden seeds; None: that of the boards here, or
            those that ship.

    Raises:
        UserError: Something is wrong with the file, or something is missing to verify it. Any other
            exception of the code is turned into this verdict on the file.
    """
    try:
        return score_again(path, source, folder=folder)
    except UserError:
        raise
    except Exception as error:
        raise UserError(
            f"{path} could not be scored again ({describe_exception(error)}); submit the run again."
        ) from error


def score_again(path: Path, source: Source, *, folder: Path | None = None) -> Verdict:
    """Check and score one committed record.

    The arguments are those of ``verify``. An exception other than UserError is a mistake of
    tactibench.

    Raises:
        UserError: Something is wrong with the file, or something is missing to verify it.
    """
    record, where = read_submission(path), str(path)
    refuse_names(record, where)
    protocol = recorded_version(record.protocol.label, record.protocol.hash, where)
    if record.signature != (signature := make_signature(record)):
        raise UserError(f"{where}: the signature is {record.signature}, but should be {signature}.")
    refuse_borrowed_name(record, protocol.spec.answer, where)
    place = answers_file(path)
    answers, ranked = split_ranked(read_answers_file(place))
    if arrays_hash(answers) != record.identity.predictions_hash:
        raise UserError(
            f"the predictions in {place} are not those of {path.name} (hash "
            f"{arrays_hash(answers)[:12]}, the record says "
            f"{record.identity.predictions_hash[:12]}); submit the run again."
        )
    seed = None
    if record.test_sensor is not None and HIDDEN in record.test_sensor.options:
        own = path.resolve().parent.parent.parent / "hidden"  # its board may reveal the seed
        seed = recorded_seed(protocol, record.identity.hidden or "", folder, own)
    truth = make_truth(record, protocol, source, seed)
    frames = len(truth["press"])
    shown = frames // (len(labelled_counts(record, protocol)) or 1)
    guarded = bool(protocol.spec.families)
    check_answers(answers, protocol.spec.answer, frames, str(place), guarded=guarded)
    if guarded:
        failed, stated = failures_record(answers, truth["group"].tolist()), record.data.failures
        if (stated.json_values() if stated else None) != failed:
            raise UserError(
                f"{where} states other failures of the model than its answers list; submit the "
                "run again."
            )
    again = score_arrays(protocol.spec, truth, answers, {})
    refuse_differences(record.metrics, again, where)
    _refuse_ranked(ranked, ranked_errors(protocol.spec, truth, answers), place)
    from_answers = tuple(row for row in again if row.metric not in FROM_MAPS)
    return Verdict(path, record, shown, from_answers)


def refuse_borrowed_name(record: Record, answer: str, where: str) -> None:
    """Raise UserError for a run of somebody else's model under the name of one that ships.

    Args:
        record: The record.
        answer: Kind of the answers, "contacts", "plate" or "sites".
        where: Name of the record in messages.
    """
    name, shipped = record.model.name, shipped_models().for_answer(answer)
    if name not in shipped.specs:
        return
    made_by = record.identity.plugins.get(shipped.origins[name].plugin, {}).get("distribution")
    if made_by != SHIPPED:
        raise UserError(
            f"{where} calls its model {name!r}, which is the name of a model that ships with "
            f"tactibench; the record names {made_by or 'no distribution'} as its author. Give the "
            "model another name."
        )
    shipped[name].check(record.model.parameters)


def refuse_differences(stated: Sequence[Metric], again: Sequence[Metric], where: str) -> None:
    """Raise UserError where a stated row is not what the answers give.

    Of metrics of heatmaps, and of those that also depend on the sensor (FROM_SENSOR), only the form
    is compared.

    Args:
        stated: Rows of the record.
        again: Rows computed from the answers.
        where: Name of the record in messages.
    """
    before, after = ({(row.metric, row.group): row for row in rows} for rows in (stated, again))
    others = [f"{metric} of {group}" for metric, group in sorted(set(before) ^ set(after))]
    if others or len(before) < len(stated):
        raise UserError(
            f"{where} does not state every metric that the protocol asks for once, and no other: "
            f"{', '.join(others) or 'one is stated twice'}."
        )
    for (metric, group), row in before.items():
        computed = after[metric, group]
        for name in FORM if metric in {*FROM_MAPS, *FROM_SENSOR} else Metric.model_fields:
            if not _is_equal(getattr(row, name), getattr(computed, name), TOLERANCE):
                raise UserError(
                    f"{where} states {name} {getattr(row, name)} for {metric} of {group}, but "
                    f"its predictions give {getattr(computed, name)}."
                )


def _is_equal(stated: Any, again: Any, tolerance: float) -> bool:
    if isinstance(stated, float | int) and isinstance(again, float):
        return math.isclose(stated, again, rel_tol=tolerance, abs_tol=1e-9)
    return bool(stated == again)


def _refuse_ranked(stated: Arrays, again: Arrays, place: Path) -> None:
    """Raise UserError unless the errors that a board ranks by are those of the answers."""
    same = set(stated) == set(again) and all(
        stated[name].shape == array.shape
        and (
            np.allclose(stated[name], array, rtol=TOLERANCE, atol=NEGLIGIBLE_MM)
            if array.dtype.kind == "f"
            else bool((stated[name] == array).all())
        )
        for name, array in again.items()
    )
    if not same:
        raise UserError(
            f"the errors of single presses in {place}, by which a board ranks, are not those of "
            "its predictions; submit the run again."
        )


# -- the truth ---------------------------------------------------------------------------------


def make_truth(
    record: Record, protocol: LoadedProtocol, source: Source, hidden: HiddenSeed | None
) -> Mapping[str, Any]:
    """Return the truth of the test set that a record names.

    Args:
        record: Record of a run.
        protocol: The protocol that it answers.
        source: Sources of the truth.
        hidden: Hidden seed of the test presses; None: the protocol's seed.

    Returns:
        Packed true answers with press and group, and the bounds that the metrics need.

    Raises:
        UserError: The test set cannot be made on this machine, or the record does not agree with
            its own options.
    """
    options = options_of_test(record)
    if options.data is not None:
        options = replace(options, data=source.data)
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
    seen = record.data.of_tested_sensor
    identity = [
        protocol.hash,
        sensor.component.identity,
        tested and tested.component.identity,
        options.reference,
        hidden and hidden.commitment,
        str(source.data),
        counts := labelled_counts(record, protocol),
        limits := bool(record.metric(LIMIT, "all")),
        seen and seen.described.get("sha256"),
    ]
    key = digest(identity)
    if key not in source.truths:
        source.truths[key] = _truth(record, frame_source(request), counts, limits)
    return source.truths[key]


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


def options_of_test(record: Record) -> TestOptions:
    """Return the options of the test of a record; a folder is named by its last two names only."""
    texts = [] if record.test_sensor is None else record.test_sensor.options
    return read_test_options(
        tuple(text for text in texts if text != HIDDEN), hidden=HIDDEN in texts
    )


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


def _truth(record: Record, frames: FrameSource, counts: tuple[int, ...], limits: bool) -> Arrays:
    if isinstance(frames, DrawnFrames):
        return _drawn_truth(frames, limits)
    sets = frames.test_frames()
    opened = [frame_set.open(lambda _: None) for frame_set in sets]
    truth = true_answers(frames.spec, opened)
    clusters = [press for frame_set in sets for press in frame_set.clusters]
    if isinstance(frames, TransferFrames):
        _check_same_recording(record, frames)
        return few_shot_truth(frames, truth, clusters, counts)
    groups = [group for frame_set in sets for group in frame_set.groups]
    arrays = truth_arrays(frames, truth, clusters, groups)
    if frames.published:
        protocol = frames.request.protocol
        published = find_published(protocol, frames.request.data, None)
        names = [name for presses in opened for name in presses.names]
        arrays |= published_arrays(published, protocol.test_frames, names, truth)
    return arrays


def _check_same_recording(record: Record, frames: TransferFrames) -> None:
    """Raise UserError where the recording in the folder is not the one that was tested."""
    seen, test = record.data.of_tested_sensor, record.test_sensor
    stated = None if seen is None else seen.described.get("sha256")
    if stated is None or stated != frames.target.identity["describe"].get("sha256"):
        raise UserError(
            f"{record.name} was tested on {'' if test is None else test.description}, which is "
            f"not the recording in {frames.request.test_data}; name its folder with --data DIR."
        )


def _drawn_truth(frames: DrawnFrames, limits: bool) -> Arrays:
    """Return the truth of drawn scenes: a simulated sensor reaches every pose that is requested.

    Args:
        frames: The presses.
        limits: Whether the record states two-point limits.
    """
    sets = frames.test_frames()
    scenes = [scene for frame_set in sets for scene in frame_set.scenes]
    radius = frames.testing.pressed.workspace.dome_radius_mm
    arrays = truth_arrays(
        frames,
        [true_contacts(scene, radius) for scene in scenes],
        [press for frame_set in sets for press in frame_set.clusters],
        [group for frame_set in sets for group in frame_set.groups],
    )
    main = [frame_set.scenes for frame_set in sets if not frame_set.apart]
    seed = np.random.SeedSequence(frames.testing.protocol.data_seed)
    bounded = "rmse_over_bound" in frames.spec.metrics.names
    if not (bounded or limits):
        return arrays
    with frames.testing.open(seed) as sensor:
        bounds: list[FloatArray | None] = [
            sensor.bound(scene) for scenes in main for scene in scenes if bounded
        ]
        spacings = [sampled_limits(sensor, scenes) for scenes in main if limits]
    for name, values in (("bound", bounds), ("limit", spacings)):
        known = [value for value in values if value is not None]
        if known and len(known) == len(values):  # else the sensor does not know one of them
            arrays[name] = np.concatenate(known)
    return arrays
