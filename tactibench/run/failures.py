"""Asking a model about hard cases: a frame on which it fails is counted, and the run goes on.

Every other protocol stops at such a frame, loudly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, Frame
from tactibench.plugins.base import Model
from tactibench.run.predict import NotFiniteError, predict_all

Arrays = dict[str, npt.NDArray[Any]]

COLUMNS = {"failed": ("i", ()), "raised": ("b", ()), "cause": ("U", ())}
"""Of ``Failures.arrays``: kind of type, and shape of a row."""
LONGEST = 200
"""Characters of a cause that are kept."""
SHOWN = 20
"""Causes that a record names; it counts all."""
_REFUSED = "holds a value that is not finite"
"""How `Contacts` refuses NaN and infinity."""


@dataclass(frozen=True)
class Failure:
    """A frame without an answer. raised: by an exception; else a number was not finite."""

    row: int
    raised: bool
    cause: str


@dataclass
class Failures:
    """The frames on which a model failed, collected while it is asked."""

    found: list[Failure] = field(default_factory=list)

    def predict_all(
        self,
        model: Model,
        frames: Sequence[Frame],
        answer: str,
        max_contacts: int | None,
        shape: tuple[int, int],
        advance: Callable[[int], None],
    ) -> tuple[list[Answer | None], None]:
        """As ``predictions.predict_all``, but no contacts where the model fails, and no maps.

        An exception that is none of the model's, such as an interruption, is not caught.
        """
        answers: list[Answer | None] = []
        for row, frame in enumerate(frames):
            try:
                found, _ = predict_all(model, [frame], answer, max_contacts, shape, lambda _: None)
            except Exception as error:  # noqa: BLE001 - whatever a plugin raises is counted
                self.found.append(Failure(row, not _not_finite(error), _said(error)))
                found = [Contacts.none()]
            answers += found
            advance(1)
        return answers, None

    def arrays(self) -> Arrays:
        """failed (F,) rows, raised (F,), cause (F,): stored with the answers."""
        return {
            "failed": np.array([one.row for one in self.found], dtype=np.int64),
            "raised": np.array([one.raised for one in self.found], dtype=bool),
            "cause": np.array([one.cause for one in self.found], dtype=np.str_),
        }


def failures_record(
    predicted: Mapping[str, npt.NDArray[Any]], groups: Sequence[str]
) -> dict[str, Any]:
    """What the record says of them: how many, and the first of every cause with its case.

    {} for answers that were not asked for so.
    """
    if "failed" not in predicted:
        return {}
    rows: Iterable[tuple[int, str]] = zip(
        predicted["failed"].tolist(), predicted["cause"].tolist(), strict=True
    )
    causes: dict[str, dict[str, Any]] = {}
    for row, cause in rows:
        one = causes.setdefault(cause, {"cause": cause, "first": groups[row], "frames": 0})
        one["frames"] += 1
    return {
        "failures": {"frames": len(predicted["failed"]), "causes": list(causes.values())[:SHOWN]}
    }


def _not_finite(error: Exception) -> bool:
    refused = isinstance(error, ValueError) and str(error).endswith(_REFUSED)
    return refused or isinstance(error, NotFiniteError)


def _said(error: Exception) -> str:
    """ "ValueError: shapes do not fit", on one line."""
    text = " ".join(f"{type(error).__name__}: {error}".split())
    return "".join(sign for sign in text if sign.isprintable())[:LONGEST]
