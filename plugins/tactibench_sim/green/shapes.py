"""The fields of one contact alone at every depth, for any radius."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from tactibench import UserError
from tactibench_sim.green.kernel import Kernel, tableau
from tactibench_sim.green.lookup import Array
from tactibench_sim.green.single import field, polar_samples, press
from tactibench_sim.mechanics.tables import Table

DEPTHS = (0.0625, 0.125, 0.25, 0.375, 0.5, 0.75, *(k / 2 for k in range(2, 14)))
"""mm; cubic splines in between."""
DEEPEST_MM = DEPTHS[-1]
SMALLEST_MM = 1.0


@dataclass(frozen=True, eq=False)
class Shape:
    """Single contacts of one radius.

    depth: (D,) knots mm, from 0. tableaus: (4, D - 1, C, 4, 4) and load: (4, D - 1) cubic
    coefficients over depth, highest first; the load is the one that softens, E_skin mm^2.
    force: (D,) total, E_skin mm^2, the sum of the forces along the rings' own normals.
    """

    radius: float
    depth: Array
    tableaus: Array
    load: Array
    force: Array


def shape(kernel: Kernel, radius: float, table: Table | None = None) -> Shape:
    """Press a sphere of ``radius`` mm (inf: a plate) to every depth; about a second.

    table: of finite elements for this radius, whose fields are taken instead of the kernel's.
    Raises UserError for radii below SMALLEST_MM.
    """
    if not radius >= SMALLEST_MM:
        raise UserError(
            f"the indenter's radius is {radius:g} mm; the tier green takes {SMALLEST_MM:g} mm and "
            "more, a sharper tip needs the finite elements."
        )
    rings = [press(kernel, radius, depth) for depth in DEPTHS]
    if table is None:
        fields = np.stack([field(kernel, ring) for ring in rings])
    else:
        fields = np.stack([_measured(kernel, table, depth) for depth in DEPTHS])
    depth = np.array([0.0, *DEPTHS])
    tableaus = CubicSpline(depth, np.concatenate([np.zeros_like(fields[:1]), fields]), axis=0)
    load = CubicSpline(depth, [0.0, *(ring.load for ring in rings)])
    force = np.array([0.0, *(ring.force.sum() for ring in rings)])
    return Shape(radius, depth, np.ascontiguousarray(tableaus.c), load.c.copy(), force)


def _measured(kernel: Kernel, table: Table, depth: float) -> Array:
    """Return the (C, 4, 4) tableau of a tabulated contact."""
    chord, polar = polar_samples(kernel)
    rows = []
    for quantity in ("w_outer", "t_outer", "w", "t"):
        meridian = CubicSpline(table.delta, table.fields[quantity], axis=0)(depth)
        rows.append(CubicSpline(table.polar, meridian)(polar))
    return tableau(chord, np.stack(rows))
