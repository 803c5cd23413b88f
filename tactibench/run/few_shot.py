"""Answers after few labelled frames of the tested sensor, in a protocol that changes the sensor.

Every test frame is answered once for each number of labelled frames; those answers are a group of
their own, named by that number. A protocol that trains and tests on one sensor has one group of
each test set and shows no such frames.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Frame
from tactibench.plugins.base import Model
from tactibench.run.plan import RunPlan
from tactibench.run.train import Reporter, open_frames
from tactibench.run.truth import true_answers

Row = TypeVar("Row")
Asked = tuple[list[Answer | None], npt.NDArray[np.float16] | None]


@dataclass(frozen=True, eq=False)
class Shots:
    """counts: numbers of labelled frames, rising from 0; (): the protocol shows none.

    frames, truth: the labelled frames; the first k are shown for k.
    """

    counts: tuple[int, ...] = ()
    frames: Sequence[Frame] = ()
    truth: Sequence[Answer] = ()

    def __len__(self) -> int:
        """How often every test frame is answered."""
        return max(1, len(self.counts))

    def repeated(self, rows: Sequence[Row]) -> list[Row]:
        """Something of every test frame, once for each number of labelled frames."""
        return list(rows) * len(self)

    def groups(self, own: Sequence[str]) -> list[str]:
        """Groups of ``repeated`` test frames."""
        if not self.counts:
            return list(own)
        return [str(count) for count in self.counts for _ in own]

    def chosen(self, model: Model) -> list[dict[str, Any]]:
        """What the model says it chose for each number of labelled frames."""
        if not self.frames:
            return []
        found = [{"shots": count, **self._shown(model, count)} for count in self.counts]
        self._shown(model, 0)
        return found

    def each(self, model: Model, ask: Callable[[], Asked]) -> Asked:
        """Answers to all test frames for every number in turn; the model is left as it was trained.

        Heatmaps are those without labelled frames.
        """
        if not self.frames:
            return ask()
        found: list[Answer | None] = []
        heat: npt.NDArray[np.float16] | None = None
        for count in self.counts:
            self._shown(model, count)
            answers, maps = ask()
            found += answers
            heat = maps if count == 0 else heat
        self._shown(model, 0)
        return found, heat

    def record(self, plan: RunPlan, chosen: list[dict[str, Any]]) -> dict[str, Any]:
        """What of the tested sensor a model saw before it was asked; {} where that is the trained
        one."""
        if plan.protocol.keys.transfer is None:
            return {}
        return {
            "of_tested_sensor": {
                "rest_image": True,
                "unlabelled_frames": 0,
                "labelled_frames": list(self.counts),
                "left_out_calibrated": plan.frames.calibrated,
                "described": (plan.frames.tested_identity or {}).get("describe", {}),
                "adapted": chosen,
            }
        }

    def _shown(self, model: Model, count: int) -> dict[str, Any]:
        return dict(model.adapt(list(self.frames[:count]), list(self.truth[:count])) or {})


def open_shots(plan: RunPlan, model: Model, reporter: Reporter) -> Shots:
    """The labelled frames of a plan. A model that cannot adapt is shown none: it has the group "0"
    alone."""
    keys, wanted = plan.protocol.keys, plan.frames.shots
    if keys.transfer is None or wanted is None:
        return Shots()
    if model.adapt([], []) is None:
        return Shots((0,))
    presses = open_frames(wanted, reporter)
    return Shots(keys.transfer.shots, presses.frames, true_answers(keys, [presses]))
