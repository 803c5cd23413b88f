"""Answers of a run held against the truth, for figures that a record alone cannot make.

A stored run has its truth beside it. Of a committed record only the answers are kept: the presses
are drawn again from the protocol, and the truth counts only where it gives the record's own errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Contacts, PlatePose
from tactibench.metrics.trials import PlateTrials, Trials
from tactibench.protocols.schema import Protocol
from tactibench.records.answers import unpack_plates

Arrays = Mapping[str, npt.NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Answered:
    """names: of the N test frames, one a frame. presses: their press ids."""

    keys: Protocol
    trials: Trials | PlateTrials
    presses: tuple[str, ...]

    @property
    def single(self) -> bool:
        """Whether the best prediction of every frame is scored, without a gate, as in exp1."""
        trials = self.trials
        one = isinstance(trials, Trials) and bool((trials.true_counts == 1).all())
        return one and self.keys.test.group == "all"


@dataclass(frozen=True, eq=False)
class Truth:
    """Of N test frames, unpacked once for all runs that were tested on them."""

    answers: tuple[Contacts, ...] | tuple[PlatePose | None, ...]
    press: npt.NDArray[Any]
    presses: tuple[str, ...]
    groups: tuple[str, ...]


def unpacked_truth(keys: Protocol, truth: Arrays) -> Truth:
    """From arrays whose hash was verified.

    Raises KeyError, IndexError or ValueError for arrays that are no answers of this protocol.
    """
    plate = keys.answer == "plate"
    names, groups = (tuple(map(str, truth[name].tolist())) for name in ("press", "group"))
    answers = unpack_plates(truth) if plate else stored_contacts(truth)
    return Truth(answers, truth["press"], names, groups)


def answered(keys: Protocol, truth: Truth, predicted: Arrays) -> Answered:
    """Maps and bounds are left out: no figure needs them. Raises as ``unpacked_truth`` does."""
    level = keys.test.level
    if keys.answer == "plate":
        plates = PlateTrials(
            cast("Any", truth.answers),
            unpack_plates(predicted),
            truth.press,
            level=level,
            group=truth.groups,
        )
        return Answered(keys, plates, truth.presses)
    contacts = Trials(
        cast("Any", truth.answers),
        stored_contacts(predicted),
        truth.press,
        truth.groups,
        max_depth=keys.workspace.depth_max_mm,
        gate=keys.test.gate_mm,
        level=level,
    )
    return Answered(keys, contacts, truth.presses)


@dataclass(frozen=True, eq=False)
class _Stored(Contacts):
    """Contacts that were checked when they were packed, which their file's hash vouches for.

    Checking 200 runs frame by frame again would take as long as all else that a report does.
    """

    def __post_init__(self) -> None:
        pass


def stored_contacts(arrays: Arrays) -> tuple[Contacts, ...]:
    """As ``unpack_contacts``, of arrays that were verified: checked as a whole, without deviations.

    Raises ValueError for counts that do not fit, or values that are not finite.
    """
    xy, depth, score = (
        np.asarray(arrays[name], dtype=np.float64) for name in ("xy", "depth", "score")
    )
    ends = np.cumsum(arrays["count"]).tolist()
    total = ends[-1] if ends else 0
    if xy.shape != (total, 2) or depth.shape != (total,) or score.shape != (total,):
        raise ValueError(f"{total} contacts are counted, but others are stored")
    if not (np.isfinite(xy).all() and np.isfinite(depth).all() and np.isfinite(score).all()):
        raise ValueError("a stored contact is not finite")
    for column in (xy, depth, score):
        column.setflags(write=False)
    starts = [0, *ends[:-1]]
    return tuple(
        _Stored(xy[a:b], depth[a:b], score[a:b]) for a, b in zip(starts, ends, strict=True)
    )
