"""Presses with several contacts: their equivalents, and the laws learned from them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from tactibench import Answer, Contacts, Frame
from tactibench.superposition import (
    NeighbourLaw,
    Residual,
    contact_array,
    nominal_inverse_law,
)

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.intp]

_ELSEWHERE = 1.0
"""Weight with which the law is held to the nominal one where there was no press. With it, after a
training on level pairs and triangles of 8 mm, OSPA is 0.083 mm on uneven pairs, 0.088 on crooked
triangles and 0.37 on three in a row; without it 0.58, 0.28 and 1.00. On the trained shapes it is
0.024 and 0.081 with it, and 0.024 and 0.088 without it (``benchmarks/held_out_geometry.py``, 100
presses of another seed)."""


@dataclass(frozen=True, eq=False)
class MultiContactPresses:
    """Presses with the same number of contacts.

    Attributes:
        rows: (S,) rows among all frames.
        contacts: (S, K, 3) true contacts, mm.
        equivalents: (S, K, 3) equivalents, mm.
        left: (C, Q) residuals of the equivalents, px, in frames whose pins were all sure.
    """

    rows: Rows
    contacts: Array
    equivalents: Array
    left: Array

    @classmethod
    def of(
        cls,
        explain: Callable[[Sequence[Frame], Array], tuple[Array, Array]],
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        rows: Rows,
    ) -> Self:
        """Return presses whose frames are explained by their true contacts.

        Args:
            explain: Returns equivalents and residuals of frames with (S, K, 3) true contacts, mm.
            frames: All frames.
            truth: The true contacts of all frames.
            rows: (S,) rows of the presses among the frames.
        """
        contacts = contact_array([truth[int(row)] for row in rows])
        return cls(rows, contacts, *explain([frames[int(row)] for row in rows], contacts))

    @property
    def shifts(self) -> Array:
        """Shifts (S, K, 3) from the equivalents to the contacts, mm."""
        return self.contacts - self.equivalents


def rows_by_count(truth: Sequence[Answer]) -> list[Rows]:
    """Return the rows of presses with two contacts, with three, and so on; none is empty."""
    counts = np.array([len(t) if isinstance(t, Contacts) else 0 for t in truth], dtype=int)
    return [np.flatnonzero(counts == count) for count in np.unique(counts[counts > 1])]


def learn_laws(
    groups: Sequence[MultiContactPresses], held_out: int | None = None
) -> tuple[NeighbourLaw, Residual]:
    """Return the law of how contacts act on each other, and what it leaves of pairs.

    Without presses it is the nominal law.

    Args:
        groups: Presses to learn from.
        held_out: One in this many presses of a group, from its first, is left out; None: none is.
    """
    equivalents, shifts = [], []
    for group in groups:
        keep = np.ones(len(group.rows), dtype=bool)
        if held_out is not None:
            keep[::held_out] = False
        equivalents.append(group.equivalents[keep])
        shifts.append(group.shifts[keep])
    law = NeighbourLaw.learn(equivalents, shifts, nominal_inverse_law(), _ELSEWHERE)
    for pairs, shift in zip(equivalents, shifts, strict=True):
        if pairs.shape[1] == 2:
            return law, Residual.learn(pairs, shift - law.shift(pairs))
    return law, Residual.none()
