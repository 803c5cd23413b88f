"""Are these arrays answers to so many frames? Checked before a metric sees them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.errors import UserError
from tactibench.run.hard_cases import FAILURE_COLUMNS as FAILURES
from tactibench.run.hard_cases import LONGEST_CAUSE

Arrays = Mapping[str, npt.NDArray[Any]]

MOST = 64
"""Contacts in a frame; no protocol presses more than three."""
CONTACTS = {
    "count": ("i", ()),
    "xy": ("f", (2,)),
    "depth": ("f", ()),
    "score": ("f", ()),
    "std": ("f", (3,)),
}
PLATES = {
    "given": ("b", ()),
    "plate_depth": ("f", ()),
    "plate_tilt": ("f", ()),
    "plate_std": ("f", (2,)),
}


def check_answers(
    answers: Arrays, kind: str, frames: int, where: str, *, guarded: bool = False
) -> None:
    """Raise UserError unless the arrays are packed answers (see ``pack``) to ``frames`` frames.

    kind: "contacts" or "plate". guarded: whether the frames on which the model failed are listed
    beside them (see ``Failures``).
    """
    given = answers
    if guarded:
        answers = {name: array for name, array in answers.items() if name not in FAILURES}
    columns = PLATES if kind == "plate" else CONTACTS
    if set(answers) != set(columns):
        raise UserError(
            f"{where} holds the arrays {', '.join(sorted(answers)) or 'none'}; answers that are "
            f"{kind} are {', '.join(sorted(columns))}."
        )
    for name, (letter, shape) in columns.items():
        array = answers[name]
        if array.dtype.kind != letter or array.shape[1:] != shape or array.ndim != 1 + len(shape):
            raise UserError(
                f"{where}: array {name!r} has type {array.dtype} and shape {array.shape}, which "
                "is not how answers are stored; submit the run with `tactibench board submit`."
            )
    first = "given" if kind == "plate" else "count"
    rows = len(answers[first])
    if rows != frames:
        raise UserError(
            f"{where} answers {rows:,} frames, but the protocol tests {frames:,}; every test "
            "frame needs one answer."
        )
    _lengths(answers, columns, kind, where)
    for name, (letter, _) in columns.items():
        if letter == "f":
            _finite(answers[name], name, where)
    if kind != "plate" and len(answers["score"]):
        low, high = float(answers["score"].min()), float(answers["score"].max())
        if low < 0 or high > 1:
            raise UserError(f"{where}: scores go from {low:g} to {high:g}; a score lies in 0..1.")
    if guarded:
        _failures(given, frames, where)


def _failures(answers: Arrays, frames: int, where: str) -> None:
    """Rising rows of frames without contacts, each with its cause."""
    found = {name: answers.get(name, np.empty(0)) for name in FAILURES}
    for name, (letter, _) in FAILURES.items():
        array = found[name]
        if array.dtype.kind != letter or array.ndim != 1 or len(array) != len(found["failed"]):
            raise UserError(
                f"{where}: array {name!r} is missing or not how failures are stored; submit the "
                "run with `tactibench board submit`."
            )
    rows = found["failed"]
    good = (
        bool((np.diff(rows, prepend=-1) > 0).all())
        and bool((rows < frames).all())
        and not answers["count"][rows].any()
    )
    if not good:
        raise UserError(
            f"{where}: the frames on which the model failed are not rising numbers below "
            f"{frames:,} of frames without contacts; submit the run again."
        )
    if any(
        len(cause) > LONGEST_CAUSE or not cause.isprintable() for cause in found["cause"].tolist()
    ):
        raise UserError(
            f"{where}: a cause is longer than {LONGEST_CAUSE} characters or not printable."
        )


def _lengths(answers: Arrays, columns: Mapping[str, Any], kind: str, where: str) -> None:
    total = len(answers["given"]) if kind == "plate" else 0
    if kind != "plate":
        count = answers["count"]
        if count.min(initial=0) < 0 or count.max(initial=0) > MOST:
            raise UserError(
                f"{where}: a frame is answered with {int(count.max(initial=0)):,} contacts; "
                f"0 to {MOST} are allowed."
            )
        total = int(count.sum())
    wrong = [name for name in columns if name != "count" and len(answers[name]) != total]
    if wrong:
        raise UserError(
            f"{where}: array {wrong[0]!r} has {len(answers[wrong[0]]):,} rows, but the answers "
            f"are {total:,}."
        )


def _finite(array: npt.NDArray[Any], name: str, where: str) -> None:
    """NaN stands for "not stated" in whole rows of standard deviations, and for nothing else."""
    bad = ~np.isfinite(array)
    if name.endswith("std"):
        bad &= ~np.isnan(array).all(axis=1, keepdims=True)
    if bad.any():
        raise UserError(
            f"{where}: {int(bad.sum()):,} values of array {name!r} are NaN or infinite; an answer "
            "is finite, and a frame without contacts is answered with none."
        )
