"""How contacts of one press share the load: amplitudes of single-contact fields.

The field of a press is sum_i a_i T(angle to n_i; s_i) with T the tabulated single-contact field.
Tier ``superpose``: a_i = 1, s_i = delta_i. Tier ``coupled``: a_i = e_i / s_i with effective depths
e_i >= 0 such that every tip still reaches its depth or stands clear,

    e_i >= 0,   g_i = sum_j a_j w(angle(n_i, n_j); s_j) - delta_i >= 0,   e_i g_i = 0,

and s_i = max(delta_i, e_i) the depth whose shape tip i presses into the skin. So two coincident
tips are one (a_1 + a_2 = 1), a tip that lies in another's dimple carries nothing, and one beside
another's bulge carries more.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactibench_sim.spline import Array, Index, PolarTables

REACH_MM = 1.0
"""Tips this far above the skin may still be met by a bulge (which is never that high)."""
_ROUNDS = 60  # two or three do, unless a bulge lifts a tip
_SHALLOW = 1e-6  # depth, mm, whose shape stands for a tip that does not press yet
_REGULAR = 1e-10  # splits the load of exactly coincident tips evenly


def superpose(delta: Array) -> tuple[Array, Array]:
    """(a, s), each (S, K)."""
    depth = np.maximum(delta, 0.0)
    return (depth > 0).astype(np.float64), depth


def couple(skin: PolarTables, table: Index, n: Array, delta: Array) -> tuple[Array, Array]:
    """(a, s), each (S, K). skin: the outer skin's inward displacement. table: (S,) its index."""
    amplitude, shape = superpose(delta)
    near = delta > -REACH_MM
    rows = np.flatnonzero((near.sum(axis=1) > 1) & (delta > 0).any(axis=1))
    if len(rows):
        # In one order, the deepest first: where tips coincide the iteration would remember theirs.
        order = np.lexsort((*np.moveaxis(n[rows], -1, 0), -delta[rows]), axis=-1)
        deep, close = (np.take_along_axis(a[rows], order, axis=1) for a in (delta, near))
        directions = np.take_along_axis(n[rows], order[..., None], axis=1)
        loads = _couple(skin, table[rows], directions, np.where(close, deep, -REACH_MM), close)
        back = np.argsort(order, axis=-1)
        amplitude[rows], shape[rows] = (np.take_along_axis(a, back, axis=1) for a in loads)
    return amplitude, shape


def _couple(
    skin: PolarTables, table: Index, n: Array, delta: Array, near: npt.NDArray[np.bool_]
) -> tuple[Array, Array]:
    angle = np.arccos(np.clip((n[:, :, None, :] * n[:, None, :, :]).sum(axis=-1), -1.0, 1.0))
    effective, shape = np.zeros_like(delta), np.maximum(delta, 0.0)
    left = np.arange(len(delta))  # a scene that is done is not touched again: batches do not mix
    for _ in range(_ROUNDS):
        matrix = _influence(skin, table[left], angle[left], shape[left])
        effective[left] = _complementarity(matrix, delta[left], near[left])
        grown = np.maximum(np.maximum(delta[left], 0.0), effective[left])
        changing = (abs(grown - shape[left]) > 1e-13).any(axis=1)
        shape[left] = grown
        left = left[changing]
        if not len(left):
            break
    pressing = effective > 0
    amplitude = np.divide(effective, shape, out=np.zeros_like(shape), where=pressing)
    return amplitude, np.where(pressing, shape, 0.0)


def _influence(skin: PolarTables, table: Index, angle: Array, shape: Array) -> Array:
    """(S, K, K) [i, j]: depression at tip i by a unit effective depth of tip j."""
    matrix = np.empty_like(angle)
    for j in range(shape.shape[1]):
        depth = np.maximum(shape[:, j], _SHALLOW)
        meridian = skin.at_depth(table, depth, np.ones(len(depth)))
        matrix[:, :, j] = skin.at_polar(meridian, angle[:, :, j])[..., 0] / meridian[:, 0, :1]
    return matrix


def _complementarity(matrix: Array, delta: Array, near: npt.NDArray[np.bool_]) -> Array:
    """e >= 0, M e - delta >= 0, complementary: projected Gauss-Seidel finds the active set."""
    effective = np.zeros_like(delta)
    done = np.zeros(len(delta), dtype=np.bool_)
    for sweeps in (20, 80, 400, 2000):
        left = np.flatnonzero(~done)
        if not len(left):
            break
        e, m, d = effective[left], matrix[left], delta[left]
        for _ in range(sweeps):
            for i in range(d.shape[1]):
                rest = (m[:, i] * e).sum(axis=1) - m[:, i, i] * e[:, i]
                e[:, i] = np.where(near[left, i], np.maximum(0.0, d[:, i] - rest), 0.0)
        exact, fits = _solve_active(m, d, e > 0, near[left])
        effective[left] = np.where(fits[:, None], exact, e)
        done[left] = fits
    return effective


def _solve_active(
    matrix: Array, delta: Array, active: npt.NDArray[np.bool_], near: npt.NDArray[np.bool_]
) -> tuple[Array, npt.NDArray[np.bool_]]:
    """The solution for a given active set, and whether it is complementary."""
    unit = np.eye(delta.shape[1])
    both = active[:, :, None] & active[:, None, :]
    system = np.where(unit == 1, 1.0, np.where(both, (1 - _REGULAR) * matrix, 0.0))
    exact = np.linalg.solve(system, np.where(active, delta, 0.0)[..., None])[..., 0]
    gap = (matrix * exact[:, None, :]).sum(axis=-1) - delta
    fits = (exact >= -1e-12).all(axis=1) & ((gap > -1e-8) | ~near).all(axis=1)
    return np.where(active, np.maximum(exact, 0.0), 0.0), fits
