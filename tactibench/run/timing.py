"""Speed beside error: the scenarios ``single`` and ``offline`` of a trained model, and its cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactibench.contacts import Answer, Frame
from tactibench.frames.source import spread
from tactibench.plugins.base import Model
from tactibench.run.configurations import (
    answers_of,
    configurations,
    fastest,
)
from tactibench.run.cost import cost, peak_memory
from tactibench.run.device import machine
from tactibench.run.difference import compare
from tactibench.run.latency import (
    Stage,
    time_in_rounds,
    time_offline,
    time_single,
    torch_threads,
)
from tactibench.run.latency_rows import speed_rows
from tactibench.run.predict import blinded

TIMED_FRAMES = 200
"""Test frames that calls take in turn, spread over all: groups follow each other in a test."""
BUDGET_S = 12.0
"""Seconds that timing may take for one thread count; a slower model gives fewer calls."""
BATCHES = (1, 8, 32, 128)
RACE_FRAMES, RACE_CALLS, RACE_ROUNDS = 50, 50, 5
"""What decides between the ways to compute, before the chosen one is timed at length."""


@dataclass(frozen=True)
class Speed:
    """Rows for the record, raw times, what the timed configuration costs in accuracy, its size."""

    rows: list[dict[str, Any]]
    raw: dict[str, np.ndarray]
    timed: dict[str, Any]
    efficiency: dict[str, Any]


NOT_TIMED = Speed([], {}, {}, {})
"""Of a protocol of hard cases: its weights are those of others, which time them."""


def measure_speed(
    model: Model,
    frames: Sequence[Frame],
    answers: Sequence[Answer | None],
    calls: int,
    budget_s: float = BUDGET_S,
    *,
    truth: Sequence[Answer] | None = None,
) -> Speed:
    """Time frame -> answer: at batch 1 with one thread and with all, and in batches with all.

    answers: the scored ones, in float32. With the truth, the ways to compute that the model offers
    are timed against each other first, and the fastest whose error is that of float32 within 2 % is
    the one that is timed; without it, the stages that the model declares are.
    """
    picked = spread(range(len(frames)), TIMED_FRAMES)
    seen = [blinded(frames[row]) for row in picked]
    scored = [answers[row] for row in picked]
    true = None if truth is None else [truth[row] for row in picked]
    cores = int(machine()["cores_logical"] or 1)
    words, stages, raced = _chosen(model, seen, scored, true, budget_s)
    rows: list[dict[str, Any]] = []
    raw: dict[str, np.ndarray] = {}
    with peak_memory() as peak:
        for threads in sorted({1, cores}):
            with torch_threads(threads):
                sample = time_single(stages, seen, threads=threads, calls=calls, budget_s=budget_s)
            rows += speed_rows(sample, "single")
            raw[f"single_{threads}_threads_ms"] = np.asarray(sample.raw_ms)
    with torch_threads(cores):
        for batch in BATCHES:
            sample = time_offline(
                stages,
                seen,
                batch,
                threads=cores,
                calls=30,
                budget_s=budget_s / 6,
                block=5 if batch <= 8 else 1,
            )
            rows += speed_rows(sample, "offline")
            raw[f"offline_{batch}_frames_ms"] = np.asarray(sample.raw_ms)
    gap = compare(answers_of(stages, seen), scored, true)
    timed = {
        "configuration": words or model.timed_as,
        **gap.as_row(),
        "raced": raced,
    }
    return Speed(rows, raw, timed, {**cost(model, seen[0]), "peak_memory_mb": peak.mb})


def _chosen(
    model: Model,
    frames: Sequence[Frame],
    scored: Sequence[Answer | None],
    truth: Sequence[Answer] | None,
    budget_s: float,
) -> tuple[str, Sequence[Stage], list[dict[str, Any]]]:
    """The stages to time, what they are in words, and how all ways did on one thread."""
    if truth is None or not model.configurations:
        return "", model.stages(), []
    rows = spread(range(len(frames)), RACE_FRAMES)
    few = [frames[row] for row in rows]
    with torch_threads(1):
        found = configurations(model, few, [scored[r] for r in rows], [truth[r] for r in rows])
        samples = time_in_rounds(
            found.stages(), few, threads=1, calls=RACE_CALLS, rounds=RACE_ROUNDS, budget_s=budget_s
        )
    best = fastest(found.usable, samples)
    raced = [
        {
            "configuration": one.words,
            "p50_ms": float(np.median(samples[one.name].total_ms)),
            **one.difference.as_row(),
        }
        for one in found.usable
    ]
    return best.words, best.stages, raced
