"""The score: from stored arrays to metric rows, in a fresh run and in ``tactibench score``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactibench.errors import UserError, describe_exception
from tactibench.protocols import (
    ApartTest,
    LoadedProtocol,
    Protocol,
    family_of,
    recorded_version,
    subgroup,
)
from tactibench.records import (
    STORE,
    Metric,
    Record,
    StoredRun,
    complete_run,
    unpack_contacts,
    unpack_plates,
)

if TYPE_CHECKING:
    from tactibench.metrics import AnyTrials

SCORING_STREAM = 1_000_000
"""Spawn key of the data seed behind bootstrap intervals."""
THRESHOLD, LIMIT = "threshold_mm", "limit_mm"
WHOLE = ("all", "mean")
"""Groups of a metric that contain all frames of a test."""
PUBLISHED = "released."
"""Begins the names of arrays of published predictions: ``released.<table>.<array>``."""

Arrays = Mapping[str, npt.NDArray[Any]]


def score_arrays(
    protocol: Protocol, truth: Arrays, predicted: Arrays, maps: Arrays
) -> list[Metric]:
    """Return the metric rows of a record.

    Args:
        protocol: The protocol, which names the metrics.
        truth: Packed true answers with ``press`` and ``group`` of every frame, and published
            predictions for these frames.
        predicted: Packed answers.
        maps: Heatmaps and true surfaces, where there are any.

    Raises:
        UserError: A metric does not apply to the answers.
    """
    from tactibench.metrics import FORCE, PlateTrials
    from tactibench.metrics.registry import score

    seed = np.random.SeedSequence(protocol.data_seed, spawn_key=(SCORING_STREAM,))
    trials = trials_of(protocol, truth, predicted, maps)
    names: tuple[str, ...] = protocol.metrics.names
    if "limit" in truth:  # it is shown after the threshold where the sensor knows it
        after = names.index(THRESHOLD) + 1
        names = (*names[:after], LIMIT, *names[after:])
    if "force" in truth and "force" in predicted:
        names = (*names, FORCE)
    if isinstance(trials, PlateTrials) and trials.published:
        from tactibench.metrics import PUBLISHED_NAMES

        names = (*names, *(name for name in PUBLISHED_NAMES if name not in names))
    metrics = score(names, trials, rng=np.random.default_rng(seed))
    for test in protocol.test.apart:
        apart = trials_of(protocol, truth, predicted, apart=test)
        if len(apart):
            rows = score(test.metrics, apart, rng=np.random.default_rng(seed))
            metrics += [_of_apart(test, row) for row in rows]
    return metrics


def _of_apart(test: ApartTest, row: Metric) -> Metric:
    """Return a metric of a test that is scored apart, with the test's name in its group."""
    group = test.name if row.group in WHOLE else subgroup(test.name, row.group)
    return row.model_copy(update={"group": group})


def trials_of(
    protocol: Protocol,
    truth: Arrays,
    predicted: Arrays,
    maps: Arrays | None = None,
    apart: ApartTest | None = None,
) -> AnyTrials:
    """Return the trials that the metrics are computed from.

    Args:
        protocol: The protocol of the run.
        truth: Packed true answers with ``press`` and ``group`` of every frame, and ``gate``, mm,
            where the sensor has a range of its own.
        predicted: Packed answers.
        maps: Heatmaps and true surfaces; None where there are none, and the metrics of heatmaps are
            n/a.
        apart: The test that is scored apart from the main test; None for the main test. Where
            several sensors press its scenes, the unit of its intervals is the sensor: what is
            unusual about a sensor is in all of its presses.
    """
    from tactibench.metrics import PlateTrials, SiteTrials, Trials

    if protocol.answer == "sites":
        return SiteTrials(
            truth["touched"],
            predicted["touched"],
            predicted["probability"],
            truth["press"],
            tuple(map(str, truth["group"])),
            protocol.test.level,
        )
    if protocol.answer == "plate":
        return PlateTrials(
            unpack_plates(truth),
            unpack_plates(predicted),
            truth["press"],
            level=protocol.test.level,
            published=unpack_published(truth),
            group=tuple(str(group) for group in truth["group"]),
        )
    rows = _rows_of(protocol, truth, apart)
    true, answers = unpack_contacts(truth), unpack_contacts(predicted)
    groups = [str(truth["group"][row]) for row in rows]
    if apart is not None:  # its own groups follow the name of the test
        groups = [group.removeprefix(subgroup(apart.name, "")) for group in groups]
    by_sensor = apart is not None and apart.instances
    trials = Trials(
        tuple(true[row] for row in rows),
        tuple(answers[row] for row in rows),
        np.array(groups) if by_sensor else truth["press"][rows],
        tuple(groups),
        max_depth=protocol.workspace.depth_max_mm,
        gate=float(truth["gate"]) if "gate" in truth else protocol.test.gate_mm,
        level=protocol.test.level,
        axes=protocol.axes,
        failed=_failures(predicted),
    )
    if apart is not None:
        return trials
    # Only the frames of the main test have a true surface, bounds and limits: they are the first.
    maps, bound = maps or {}, truth.get("bound")
    counts = np.cumsum(truth["count"][rows])[:-1]
    return replace(
        trials,
        maps=None if "maps" not in maps else maps["maps"][: len(rows)],
        surface=maps.get("surface"),
        floor=maps.get("floor"),
        bound=None if bound is None else tuple(np.split(bound, counts)),
        limit=truth.get("limit"),
    )


def _rows_of(protocol: Protocol, truth: Arrays, apart: ApartTest | None) -> npt.NDArray[np.intp]:
    """Return the rows of the main test's frames, or of a test that is scored apart.

    The groups of frames of such a test begin with its name.
    """
    names = [apart_set.name for apart_set in protocol.test.apart]
    test_of = np.array([family_of(str(group)) for group in truth["group"]])
    return np.flatnonzero(~np.isin(test_of, names) if apart is None else test_of == apart.name)


def _failures(predicted: Arrays) -> npt.NDArray[np.int8] | None:
    """Return (N,) how the model failed on every frame; None where a failure ends the run.

    The values are NOT_FINITE, RAISED, or 0 where it answered.
    """
    from tactibench.metrics import NOT_FINITE, RAISED

    if "failed" not in predicted:
        return None
    failures = np.zeros(len(predicted["count"]), dtype=np.int8)
    failures[predicted["failed"]] = np.where(predicted["raised"], RAISED, NOT_FINITE)
    return failures


def unpack_published(arrays: Arrays) -> dict[str, Any]:
    """Return the published predictions among the arrays, by table."""
    tables: dict[str, dict[str, npt.NDArray[Any]]] = {}
    for key, array in arrays.items():
        if key.startswith(PUBLISHED):
            table, _, name = key.removeprefix(PUBLISHED).rpartition(".")
            tables.setdefault(table, {})[name] = array
    return {table: unpack_plates(packed) for table, packed in tables.items()}


def rescore(run: StoredRun, protocol: LoadedProtocol | None = None) -> Record:
    """Return the record of a stored run with metrics computed anew, without model or sensor.

    Args:
        run: The run, with its arrays.
        protocol: The protocol that the run was made with; None for the installed one of the same
            version.

    Raises:
        UserError: The protocol of the run is not installed in the same version, or an array is not
            that of the record.
    """
    protocol = protocol or protocol_of(run)
    truth, predicted = run.arrays("truth"), run.arrays("predictions")
    metrics = score_arrays(protocol.spec, truth, predicted, run.arrays("maps"))
    return run.record.model_copy(update={"metrics": metrics})


def score_answers(answers: StoredRun, protocol: LoadedProtocol) -> StoredRun:
    """Score stored answers and complete their run. The caller holds the name of the run.

    Raises:
        UserError: The answers cannot be scored, or an invariant does not hold; the answers stay.
    """
    try:
        return complete_run(answers, rescore(answers, protocol))
    except OSError:
        raise
    except Exception as error:  # of any kind: the user must be told that the answers are stored
        why = str(error) if isinstance(error, UserError) else f"{describe_exception(error)}."
        name, store = answers.record.name, answers.folder.parent
        in_store = "" if store == STORE else f" --store {store}"
        raise UserError(
            f"the answers of {name} cannot be scored: {why} They are kept: the same command, or "
            f"`tactibench score {name}{in_store}`, scores them once that is mended."
        ) from error


def protocol_of(run: StoredRun) -> LoadedProtocol:
    """Return the protocol that a run was made with.

    Raises:
        UserError: The protocol is not installed, or only in another version.
    """
    stated = run.record.protocol
    return recorded_version(stated.label, stated.hash, str(run.folder))


def metric_differences(stored: list[Metric], again: list[Metric]) -> list[str]:
    """Return a sentence for each row of metrics that is not exactly equal in both lists."""
    before, after = (
        {(row.metric, row.group): row.json_values() for row in rows} for rows in (stored, again)
    )
    return [
        f"{metric} of {group}: stored {before.get((metric, group))}, "
        f"now {after.get((metric, group))}"
        for metric, group in sorted({*before, *after})
        if before.get((metric, group)) != after.get((metric, group))
    ]
