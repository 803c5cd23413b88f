"""Who is whose neighbour in a layout of pins at rest."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

NEIGHBOURS = 10
OPEN_DEG = 120.0
"""A pin with no neighbour in a sector this wide stands at the border."""


class Neighbours(NamedTuple):
    """rest: (P, 2); near: (P, K) the nearest; back: (P, R) whose nearest a pin is, -1 behind;
    pitch: (P,) mean distance of the four nearest, px; border: (B,) pins at the border."""

    rest: Array
    near: Index
    back: Index
    pitch: Array
    border: Index


def neighbours(rest: Array) -> Neighbours:
    """The neighbours in a layout (P, 2) of two pins or more."""
    from scipy.spatial import cKDTree

    count = min(NEIGHBOURS, len(rest) - 1)
    apart, near = (found[:, 1:] for found in cKDTree(rest).query(rest, k=count + 1))
    near = np.ascontiguousarray(near, dtype=np.int64)
    whose = [np.flatnonzero((near == p).any(axis=1)) for p in range(len(rest))]
    back = np.full((len(rest), max(map(len, whose)) + 1), -1, dtype=np.int64)
    for row, pins in zip(back, whose, strict=True):
        row[: len(pins)] = pins
    step = rest[near] - rest[:, None]
    turn = np.sort(np.arctan2(step[..., 1], step[..., 0]), axis=1)
    gap = np.diff(turn, axis=1, append=turn[:, :1] + 2 * np.pi).max(axis=1)
    pitch = np.maximum(apart[:, :4].mean(axis=1), 1e-6)
    return Neighbours(rest, near, back, pitch, np.flatnonzero(gap > np.radians(OPEN_DEG)))
