"""How far answers drift with the arithmetic, the batch and the threads: ``speed --precision``."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tactibench.contacts import Answer, Frame, PlatePose
from tactibench.errors import UserError
from tactibench.frames.source import spread
from tactibench.plugins.base import Model
from tactibench.run.arithmetic import Make, ways
from tactibench.run.configurations import COMPILED
from tactibench.run.difference import Difference, compare, mean_error_mm
from tactibench.run.latency import Stage, torch_threads
from tactibench.run.predict import blinded
from tactibench.run.timing import BATCHES

THREADS = (1, 2)
COMPILE_S = 60.0
"""Seconds that making one shape ready may take; a configuration that takes longer is left out."""
FEW = 32
"""Frames, spread over all, that smaller batches are asked of: types that are emulated are slow."""

Advance = Callable[[int], None]


@dataclass(frozen=True)
class Drift:
    """Answers of one setting beside those in float32, one frame a call, on one thread.

    apart: how far they lie from those. share: the median distance as a share of the model's own
    mean error; None where that is not known. not_finite: outputs that are no finite number, of
    ``outputs``. refused: frames whose outputs could not be read, for the first of the reasons.
    """

    configuration: str
    words: str
    batch: int
    threads: int
    apart: Difference
    share: float | None
    not_finite: int
    outputs: int
    refused: int
    reason: str = ""

    def as_row(self) -> dict[str, Any]:
        """JSON values."""
        row = asdict(self)
        gap: dict[str, Any] = row.pop("apart")
        return {**row, **gap}


@dataclass(frozen=True)
class Drifts:
    """error_mm: the model's own mean error in float32. skipped: name -> why it is left out."""

    rows: tuple[Drift, ...]
    error_mm: float | None
    skipped: dict[str, str]

    def as_json(self) -> dict[str, Any]:
        """JSON values; ``metrics`` are rows {metric, group, value, unit}."""
        return {
            "error_mm": self.error_mm,
            "skipped": dict(self.skipped),
            "drift": [row.as_row() for row in self.rows],
            "metrics": [one for row in self.rows for one in _metrics(row)],
        }


def _metrics(row: Drift) -> list[dict[str, Any]]:
    words = "1 thread" if row.threads == 1 else f"{row.threads} threads"
    group = f"{row.configuration}, batch {row.batch}, {words}"
    values = {
        "drift_median_mm": (row.apart.median_mm, "mm"),
        "drift_largest_mm": (row.apart.largest_mm, "mm"),
        "drift_of_error": (row.share, "share"),
        "not_finite": (float(row.not_finite), "1"),
    }
    return [
        {"metric": name, "group": group, "value": value, "unit": unit}
        for name, (value, unit) in values.items()
    ]


@dataclass(frozen=True)
class Read:
    """Answers of frames, and what was wrong with what they were read from."""

    answers: list[Answer | None]
    outputs: int
    not_finite: int
    refused: int
    reason: str


def run_drift(
    model: Model,
    frames: Sequence[Frame],
    truth: Sequence[Answer],
    *,
    batches: Sequence[int] = BATCHES,
    threads: Sequence[int] = THREADS,
    compiled: bool = False,
    advance: Advance = lambda _: None,
) -> Drifts:
    """Answer the frames in every way that works here and compare with ``predict`` in float32.

    A batch of more frames than there are is left out; smaller ones are asked of ``FEW`` frames.
    advance: is told of every finished way.
    """
    seen = [blinded(frame) for frame in frames]
    with torch_threads(1):
        scored = [model.predict([frame])[0] for frame in seen]
    error = mean_error_mm(scored, truth)
    found, skipped = ways(model, compiled=compiled)
    rows: list[Drift] = []
    asked = {
        batch: spread(range(len(seen)), max(batch, FEW)) for batch in batches if batch <= len(seen)
    }
    for name, (words, make) in found.items():
        try:
            for batch, count, read in _settings(name, make, seen, asked, threads):
                of = asked[batch]
                apart = compare(read.answers, [scored[r] for r in of], [truth[r] for r in of])
                share = None if apart.median_mm is None or not error else apart.median_mm / error
                rows.append(
                    Drift(
                        name,
                        words,
                        batch,
                        count,
                        apart,
                        share,
                        read.not_finite,
                        read.outputs,
                        read.refused,
                        read.reason,
                    )
                )
        except UserError as reason:
            skipped[name] = str(reason)
        advance(1)
    return Drifts(tuple(rows), error, skipped)


def _settings(
    name: str,
    make: Make,
    frames: Sequence[Frame],
    asked: Mapping[int, Sequence[int]],
    threads: Sequence[int],
) -> Iterator[tuple[int, int, Read]]:
    """(batch, threads, what was read) of one way. Raises UserError where it cannot be gone."""
    for count in threads:
        with torch_threads(count):
            began = time.monotonic()
            stages = make(frames[:1])
            for batch, rows in asked.items():
                if name == COMPILED:
                    _first_call(stages, frames[:batch], began)
                    began = time.monotonic()
                yield batch, count, read_all(stages, [frames[row] for row in rows], batch)


def _first_call(stages: Sequence[Stage], frames: Sequence[Frame], began: float) -> None:
    read_all(stages, frames, len(frames))
    took = time.monotonic() - began
    if took > COMPILE_S:
        raise UserError(
            f"to compile it for {len(frames)} frames took {took:.0f} s, more than the "
            f"{COMPILE_S:.0f} s that are waited for"
        )


def read_all(stages: Sequence[Stage], frames: Sequence[Frame], batch: int) -> Read:
    """Answers in batches; outputs that are not finite are counted before the last stage.

    The answers of a batch that the last stage refuses are None, and counted.
    """
    answers: list[Answer | None] = []
    outputs = bad = refused = 0
    reason = ""
    for start in range(0, len(frames), batch):
        value: Any = list(frames[start : start + batch])
        count = len(value)
        for _, stage in stages[:-1]:
            value = stage(value)
        size, wrong = _counted(value)
        outputs, bad = outputs + size, bad + wrong
        try:
            answers += stages[-1][1](value)
        except (UserError, ValueError) as error:  # readers and Contacts refuse what is not finite
            answers += [None] * count
            refused += count
            reason = reason or str(error)
    wrong = sum(_no_number(answer) for answer in answers)
    return Read(answers, outputs, bad + wrong, refused, reason)


def _counted(value: Any) -> tuple[int, int]:
    """How many numbers an array holds, and how many of them are not finite."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        return value.size, int(value.size - np.isfinite(value).sum())
    return 0, 0


def _no_number(answer: Answer | None) -> bool:
    """Contacts hold finite numbers alone; a plate pose is what the model says."""
    return isinstance(answer, PlatePose) and not np.isfinite([answer.depth, answer.tilt]).all()
