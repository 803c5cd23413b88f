"""From stored arrays to metric rows; the same for a fresh run and for `tactibench score`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactibench.protocols.schema import Protocol
from tactibench.records.answers import unpack_contacts, unpack_plates
from tactibench.records.record import Metric
from tactibench.run.published_predictions import unpack_released

if TYPE_CHECKING:
    from tactibench.metrics.trials import PlateTrials, Trials

SCORING_STREAM = 1_000_000
"""Spawn key of the data seed behind bootstrap intervals."""

Arrays = Mapping[str, npt.NDArray[Any]]


def score_arrays(keys: Protocol, truth: Arrays, predicted: Arrays, maps: Arrays) -> list[Metric]:
    """Rows of a record's metrics. truth also holds ``press`` and ``group`` of every frame,
    and the predictions that others published of them."""
    from tactibench.metrics.plate import PUBLISHED_NAMES
    from tactibench.metrics.score import score
    from tactibench.metrics.trials import PlateTrials

    seed = np.random.SeedSequence(keys.data_seed, spawn_key=(SCORING_STREAM,))
    trials = trials_of(keys, truth, predicted, maps)
    names = keys.metrics.names
    if isinstance(trials, PlateTrials) and trials.published:
        names = (*names, *(name for name in PUBLISHED_NAMES if name not in names))
    return score(names, trials, rng=np.random.default_rng(seed))


def trials_of(
    keys: Protocol, truth: Arrays, predicted: Arrays, maps: Arrays | None = None
) -> Trials | PlateTrials:
    """What the metrics are computed from. Without ``maps`` those of heatmaps are n/a."""
    from tactibench.metrics.trials import PlateTrials, Trials

    maps = maps or {}
    if keys.answer == "plate":
        return PlateTrials(
            unpack_plates(truth),
            unpack_plates(predicted),
            truth["press"],
            level=keys.test.level,
            published=unpack_released(truth),
            group=tuple(str(group) for group in truth["group"]),
        )
    bound = truth.get("bound")
    counts = np.cumsum(truth["count"])[:-1]
    return Trials(
        unpack_contacts(truth),
        unpack_contacts(predicted),
        truth["press"],
        tuple(str(group) for group in truth["group"]),
        max_depth=keys.workspace.depth_max_mm,
        gate=keys.test.gate_mm,
        level=keys.test.level,
        maps=maps.get("maps"),
        surface=maps.get("surface"),
        bound=None if bound is None else tuple(np.split(bound, counts)),
        axes=keys.axes,
        failed=_failed(predicted),
    )


def _failed(predicted: Arrays) -> npt.NDArray[np.int8] | None:
    """(N,) what became of the question about every frame; None where failures end a run."""
    from tactibench.metrics.trials import NOT_FINITE, RAISED

    if "failed" not in predicted:
        return None
    found = np.zeros(len(predicted["count"]), dtype=np.int8)
    found[predicted["failed"]] = np.where(predicted["raised"], RAISED, NOT_FINITE)
    return found
