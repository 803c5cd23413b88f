"""The ways in which a model can compute its answers: which work here, how far off, how fast."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactibench.contacts import Answer, Frame
from tactibench.errors import UserError
from tactibench.plugins.base import Model
from tactibench.run.difference import Difference, compare
from tactibench.run.latency import LatencySample, Stage

COMPILED = "compiled"
"""Takes tens of seconds to make, so it is left out unless asked for."""


@dataclass(frozen=True)
class Configuration:
    """One way that works on this machine, and what it costs in accuracy."""

    name: str
    words: str
    stages: Sequence[Stage]
    difference: Difference


@dataclass(frozen=True)
class Configurations:
    """Those that work, and for each other one the sentence why it does not."""

    usable: tuple[Configuration, ...]
    skipped: Mapping[str, str]

    def stages(self) -> dict[str, Sequence[Stage]]:
        return {one.name: one.stages for one in self.usable}


def answers_of(stages: Sequence[Stage], frames: Sequence[Frame]) -> list[Answer | None]:
    """Answers at batch 1, frame by frame."""
    found: list[Answer | None] = []
    for frame in frames:
        value: Any = [frame]
        for _, stage in stages:
            value = stage(value)
        found.append(value[0])
    return found


def configurations(
    model: Model,
    frames: Sequence[Frame],
    scored: Sequence[Answer | None],
    truth: Sequence[Answer],
    *,
    compiled: bool = False,
    advance: Callable[[int], None] = lambda _: None,
) -> Configurations:
    """Make every way ready and compare its answers with the float32 ones of the frames.

    A model that has no choice is timed as it is. compiled: try torch.compile, too. Raises UserError
    when none works.
    """
    if not model.configurations:
        own = list(model.stages())
        gap = compare(answers_of(own, frames), scored, truth)
        return Configurations((Configuration("default", model.timed_as, own, gap),), {})
    usable, skipped = [], {}
    for name, words in model.configurations.items():
        if name == COMPILED and not compiled:
            skipped[name] = "it takes long to make; add --compile"
            continue
        try:
            stages = list(model.configured(name, frames[:1]))
        except UserError as reason:
            skipped[name] = str(reason)
        else:
            gap = compare(answers_of(stages, frames), scored, truth)
            usable.append(Configuration(name, words, stages, gap))
        advance(1)
    if not usable:
        reasons = "; ".join(f"{name}: {reason.rstrip('.')}" for name, reason in skipped.items())
        raise UserError(f"the model cannot be timed, none of its ways to compute works: {reasons}.")
    return Configurations(tuple(usable), skipped)


def fastest(
    candidates: Iterable[Configuration], samples: Mapping[str, LatencySample]
) -> Configuration:
    """The lowest median of a whole call among those whose answers may stand for float32.

    The median, because a neighbour's work shows in the upper quantiles first. Where none is
    allowed, the first is taken: float32 as it is.
    """
    every = list(candidates)
    allowed = [one for one in every if one.difference.allowed] or every[:1]
    return min(allowed, key=lambda one: float(np.median(samples[one.name].total_ms)))
