"""From stored arrays to metric rows; the same for a fresh run and for `tactibench score`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.protocols.schema import Protocol
from tactibench.records.answers import unpack_contacts, unpack_plates
from tactibench.running.released import unpack_released

SCORING_STREAM = 1_000_000
"""Spawn key of the data seed behind bootstrap intervals."""

Arrays = Mapping[str, npt.NDArray[Any]]


def score_arrays(
    keys: Protocol, truth: Arrays, predicted: Arrays, maps: Arrays
) -> list[dict[str, Any]]:
    """Rows of ``record["metrics"]``. truth also holds ``press`` and ``group`` of every frame,
    and the answers that others released to them."""
    from tactibench.metrics.released import NAMES as RELEASED
    from tactibench.metrics.score import score
    from tactibench.metrics.trials import PlateTrials, Trials

    seed = np.random.SeedSequence(keys.data_seed, spawn_key=(SCORING_STREAM,))
    rng = np.random.default_rng(seed)
    press = truth["press"]
    trials: Trials | PlateTrials
    if keys.answer == "plate":
        trials = PlateTrials(
            unpack_plates(truth),
            unpack_plates(predicted),
            press,
            level=keys.test.level,
            released=unpack_released(truth),
        )
    else:
        bound = truth.get("bound")
        counts = np.cumsum(truth["count"])[:-1]
        trials = Trials(
            unpack_contacts(truth),
            unpack_contacts(predicted),
            press,
            tuple(str(group) for group in truth["group"]),
            max_depth=keys.workspace.depth_max_mm,
            gate=keys.test.gate_mm,
            level=keys.test.level,
            maps=maps.get("maps"),
            surface=maps.get("surface"),
            bound=None if bound is None else tuple(np.split(bound, counts)),
        )
    names = keys.metrics.names
    if isinstance(trials, PlateTrials) and trials.released:
        names = (*names, *(name for name in RELEASED if name not in names))
    return [row.as_json() for row in score(names, trials, rng=rng)]
