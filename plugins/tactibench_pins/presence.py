"""Whether anything presses at all: by how far the pins went.

Distances are those of ``eye``: px of one sensor's own pins, units of the layout on the common
lattice. They are compared with each other only.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench import Answer, Contacts
from tactibench.training import vector_answers

Array = npt.NDArray[Any]

_FAINTEST = 0.01
"""Quantile of the training presses that stands for the faintest: one may be mislabelled."""
_SHARE = 0.5
"""Of the way from a sensor at rest to the faintest training press a contact begins."""


def went(moved: Array) -> Array:
    """(N,) root mean square of displacements (N, 2 P)."""
    rms: Array = np.sqrt(np.mean(np.square(moved), axis=1))
    return rms


def least(moved: Array, answer: str) -> float:
    """How far the pins go at least where something presses, from training presses (N, 2 P).

    0 for a plate: its pose is asked for in every frame.
    """
    if answer == "plate" or not len(moved):
        return 0.0
    return float(_SHARE * np.quantile(went(moved), _FAINTEST))


def answers_of(values: Array, answer: str, at_least: float) -> list[Answer | None]:
    """Answers from rows (N, T + 1): values, mm and deg, and how far the pins went. at_least: as
    ``least`` gave it."""
    found = vector_answers(values[:, :-1], answer)
    none = Contacts.none()
    return [none if far < at_least else one for one, far in zip(found, values[:, -1], strict=True)]
