"""Speed beside error: the scenario ``single`` of a trained model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactibench.contacts import Answer, Contacts, Frame, PlatePose
from tactibench.plugins.interfaces import Model, StagedModel
from tactibench.running.device import machine
from tactibench.running.frames import spread
from tactibench.running.predictions import blinded
from tactibench.timing.latency import LatencySample, time_single, torch_threads
from tactibench.timing.rows import speed_rows

TIMED_FRAMES = 200
"""Test frames that calls take in turn, spread over all: groups follow each other in a test."""
BUDGET_S = 12.0
"""Seconds that timing may take for one thread count; a slower model gives fewer calls."""


@dataclass(frozen=True)
class Speed:
    """Rows for the record, raw times, and what the timed configuration costs in accuracy."""

    rows: list[dict[str, Any]]
    raw: dict[str, np.ndarray]
    timed: dict[str, Any]


def model_stages(model: Model) -> list[tuple[str, Callable[[Any], Any]]]:
    """The phases a model declares, or all of it as one phase."""
    if isinstance(model, StagedModel):
        return list(model.stages())
    return [("predict", model.predict)]


def measure_speed(
    model: Model,
    frames: Sequence[Frame],
    answers: Sequence[Answer | None],
    calls: int,
    budget_s: float = BUDGET_S,
) -> Speed:
    """Time frame -> answer at batch 1 with one thread and with all."""
    stages = model_stages(model)
    rows_timed = spread(range(len(frames)), TIMED_FRAMES)
    seen = [blinded(frames[row]) for row in rows_timed]
    cores = int(machine()["cores_logical"] or 1)
    rows: list[dict[str, Any]] = []
    raw: dict[str, np.ndarray] = {}
    for threads in sorted({1, cores}):
        with torch_threads(threads):
            sample: LatencySample = time_single(
                stages, seen, threads=threads, calls=calls, budget_s=budget_s
            )
        rows += speed_rows(sample, "single")
        raw[f"single_{threads}_threads_ms"] = np.asarray(sample.raw_ms)
    return Speed(rows, raw, _timed(model, stages, seen, [answers[row] for row in rows_timed]))


def _timed(
    model: Model,
    stages: Sequence[tuple[str, Callable[[Any], Any]]],
    frames: Sequence[Frame],
    answers: Sequence[Answer | None],
) -> dict[str, Any]:
    """How far the timed configuration's answers lie from the scored float32 ones."""
    apart, changed = [], 0
    for frame, scored in zip(frames, answers, strict=True):
        value: Any = [frame]
        for _, stage in stages:
            value = stage(value)
        distance = _apart(value[0], scored)
        if distance is None:
            changed += 1
        else:
            apart += distance
    return {
        "configuration": str(getattr(model, "timed_as", "as the model predicts")),
        "difference_mm": float(np.median(apart)) if apart else None,
        "frames": len(frames),
        "frames_with_another_count": changed,
    }


def _apart(timed: Answer | None, scored: Answer | None) -> list[float] | None:
    """Distances (x, y, depth) between answers in mm, contact by contact; None: other counts."""
    if timed is None and scored is None:
        return []
    if isinstance(timed, PlatePose) and isinstance(scored, PlatePose):
        return [abs(timed.depth - scored.depth)]
    if not (isinstance(timed, Contacts) and isinstance(scored, Contacts)):
        return None
    if len(timed) != len(scored):
        return None
    a = np.column_stack([timed.xy, timed.depth])
    b = np.column_stack([scored.xy, scored.depth])
    # Scores of equal contacts may change order: compare each with the nearest.
    gaps = np.linalg.norm(a[:, None] - b[None], axis=2)
    return [float(gap) for gap in gaps.min(axis=1)] if len(a) else []
