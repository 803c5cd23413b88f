"""Presses with several contacts: their equivalents, and the laws learned from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from tactibench import Answer, Contacts, Frame
from tactibench.superposition import Neighbours, Remainder, as_rows, shipped_inverse
from tactibench_superpose.detect import Detector

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Several:
    """Presses with as many contacts. rows: (S,) where among all. contacts, equivalents: (S, K, 3)
    mm. left: (C, Q) px that the equivalents leave of the frames whose pins were all sure."""

    rows: Rows
    contacts: Array
    equivalents: Array
    left: Array

    @classmethod
    def of(
        cls, detector: Detector, frames: Sequence[Frame], truth: Sequence[Answer], rows: Rows
    ) -> Self:
        """Explain the frames of these rows by the contacts that are known."""
        images = detector.eye.images([frames[int(row)] for row in rows])
        contacts = as_rows([truth[int(row)] for row in rows])
        return cls(rows, contacts, *detector.explain(images, contacts))

    @property
    def shifts(self) -> Array:
        """(S, K, 3) mm from the equivalents to the contacts."""
        return self.contacts - self.equivalents


def by_count(truth: Sequence[Answer]) -> list[Rows]:
    """Rows of the presses with two contacts, with three, and so on; none that is empty."""
    counts = np.array([len(one) if isinstance(one, Contacts) else 0 for one in truth], dtype=int)
    return [np.flatnonzero(counts == count) for count in np.unique(counts[counts > 1])]


def laws(groups: Sequence[Several], without: int | None = None) -> tuple[Neighbours, Remainder]:
    """What contacts do to each other, learned from presses, or as shipped where there are none.

    without: every so manieth press of a group, from its first, is left out.
    """
    kept = [_kept(len(group.rows), without) for group in groups]
    equivalents = [group.equivalents[keep] for group, keep in zip(groups, kept, strict=True)]
    shifts = [group.shifts[keep] for group, keep in zip(groups, kept, strict=True)]
    law = Neighbours.learn(equivalents, shifts, shipped_inverse())
    for found, shift in zip(equivalents, shifts, strict=True):
        if found.shape[1] == 2:
            return law, Remainder.learn(found, shift - law.shift(found))
    return law, Remainder.none()


def _kept(count: int, without: int | None) -> npt.NDArray[np.bool_]:
    return np.ones(count, dtype=bool) if without is None else np.arange(count) % without > 0
