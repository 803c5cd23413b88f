"""Smoothness of a displacement field on a layout: who are neighbours, do they move alike."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]

NEIGHBOURS = 10
STEEPEST = 0.4
"""Two neighbours move alike when their displacements differ by less than this share of their
distance. Between markers of real plate presses 0.35 is passed by one pair in a thousand."""
ALIKE = 0.5
"""A marker is believed when this share of its neighbours moves like it."""


@dataclass(frozen=True, eq=False)
class Layout:
    """Who is whose neighbour. near: (P, K); pitch: (P,) mean distance of the four nearest, px.

    apart: (P, K) distances. plane: (P, K) weights of the neighbours' displacements that give the
    value at the marker of the plane through them (least squares).
    """

    near: Index
    pitch: Array
    apart: Array
    plane: Array


def layout(rest: Array) -> Layout:
    """The layout of markers at rest (P, 2), remembered for the next frame."""
    return _layout(rest.tobytes())


@lru_cache(maxsize=8)
def _layout(content: bytes) -> Layout:
    from scipy.spatial import cKDTree

    rest = np.frombuffer(content).reshape(-1, 2)
    count = min(NEIGHBOURS, len(rest) - 1)
    apart, near = (found[:, 1:] for found in cKDTree(rest).query(rest, k=count + 1))
    basis = _basis(rest, near, np.arange(len(rest)))[0]
    plane = np.linalg.pinv(basis, rcond=1e-6)[:, 0]
    return Layout(near, apart[:, :4].mean(axis=1), apart, np.asarray(plane, dtype=np.float64))


def largest_part(moved: Array, known: Layout) -> Mask:
    """(P,) the largest connected part of the layout in which neighbours move alike.

    moved: (P, 2) displacements, NaN where unknown (in no part).
    """
    steps = moved[known.near] - moved[:, None]
    alike = np.hypot(steps[..., 0], steps[..., 1]) < STEEPEST * known.apart  # NaN: not alike
    sound: Mask = alike.mean(axis=1) >= ALIKE
    if sound.all() or not sound.any():
        return sound
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    count = len(moved)
    row, column = np.nonzero(alike & sound[:, None] & sound[known.near])
    links = np.ones(len(row)), (row, known.near[row, column])
    label = connected_components(coo_matrix(links, shape=(count, count)), directed=False)[1]
    part: Mask = sound & (label == np.argmax(np.bincount(label[sound], minlength=1)))
    return part


def odd(moved: Array, rest: Array, known: Layout, limit: float) -> Mask:
    """(P,) markers whose displacement leaves what their neighbours foretell by limit pitches."""
    plain = (known.plane[..., None] * moved[known.near]).sum(axis=1)
    off: Mask = ~(np.hypot(*(moved - plain).T) <= limit * known.pitch)  # NaN: odd for now
    if not off.any():
        return off
    foretold = foretell(moved, rest, known)
    return np.asarray(np.hypot(*(moved - foretold).T) > limit * known.pitch)


def _basis(rest: Array, near: Index, rows: Index) -> tuple[Array, Array]:
    """(A, K, 3) constant and slopes at the neighbours, and (A, 1) the length they count in."""
    step = rest[near] - rest[rows, None]
    scale = np.sqrt((step**2).sum(axis=-1).mean(axis=1))[:, None]
    columns = [np.ones((*near.shape, 1)), step / scale[..., None]]
    return np.concatenate(columns, axis=-1), np.asarray(scale, dtype=np.float64)


def foretell(moved: Array, rest: Array, layout: Layout, asked: Mask | None = None) -> Array:
    """Displacement that a plane through the neighbours' gives at the markers asked for, (A, 2).

    moved: (P, 2), NaN where unknown. Neighbours that leave the plane lose weight (Cauchy's, two
    rounds), so that one that is wrong does not tilt it. Zero where no neighbour is known.
    """
    rows = np.arange(len(rest)) if asked is None else np.flatnonzero(asked)
    near = layout.near[rows]
    known = np.isfinite(moved[:, 0])
    values = np.where(known[:, None], moved, 0.0)[near]  # (A, K, 2)
    basis, scale = _basis(rest, near, rows)
    weight: Array = known[near].astype(np.float64)
    ridge = np.diag([1e-9, 1e-2, 1e-2])  # no slope from neighbours on one line
    for turn in range(3):
        weighted = (basis * weight[..., None]).transpose(0, 2, 1)
        plane = np.linalg.solve(weighted @ basis + ridge, weighted @ values)
        if turn < 2:
            away = np.linalg.norm(values - basis @ plane, axis=-1)
            weight = np.asarray(known[near] / (1 + (away / (0.15 * scale)) ** 2), dtype=np.float64)
    return np.asarray(plane[:, 0], dtype=np.float64)
