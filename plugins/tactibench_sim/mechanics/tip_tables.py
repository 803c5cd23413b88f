"""Tables of spherical tips of any radius from 1 to 8 mm, between those that were computed.

The published experiments press tips of R = 3 mm; their tables are in ``tables``. The file here has
single contacts of nine radii, what the rim changes for each of them, and pairs of equal tips for
some. Everything between is a cubic spline in log R: single fields at one penetration, corrections
at one share of the greatest penetration. A radius that was computed is met exactly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from tactibench import UserError
from tactibench_sim import data_file
from tactibench_sim.mechanics.corrections import Corrections
from tactibench_sim.mechanics.tables import (
    LARGEST_MM,
    QUANTITIES,
    SMALLEST_MM,
    Table,
    Tables,
)

Array = npt.NDArray[np.float64]
FILE = "tips.npz"
SCRIPT = "scripts/fem/tabulate_tips.py"
"""Script that makes the file; it is in the repository and not in the package."""
DEEPEST_MM, DEEPEST_RADII = 4.0, 1.5
"""Tips other than the nominal one are tabulated to 4 mm, but at most to 1.5 of their radii: sharper
presses turn elements of the skin inside out."""
SHARES = 8
"""Steps of the corrections from no penetration to the greatest."""
QUANTUM = 2e-4
"""Step, mm and rad: single fields are stored as whole multiples of it, which reach 6.5 mm in two
bytes."""


def deepest(radius: float) -> float:
    """Return the greatest penetration of a tip other than the nominal one, mm."""
    return min(DEEPEST_MM, DEEPEST_RADII * radius)


@dataclass(frozen=True, eq=False)
class TipTables:
    """Single contacts of K radii and their corrections.

    Attributes:
        parameters: Parameters of the finite-element runs; ``corrections`` among them is the grid of
            ``Corrections``.
        digest: Checksum of the file.
        radii: (K,) radii, mm.
        pair_radii: (L,) radii for which pairs were computed, mm.
        delta: (D,) penetrations, mm, from 0, uniform.
        polar: (T,) polar angles, rad, from 0, uniform.
        fields: Quantity -> (K, D, T), ``force`` -> (K, D).
        arrays: Modes as in ``Corrections``, shared by all radii; ``around_amounts``
            (K, B + 2, SHARES + 3, R) and ``pair_amounts`` (L, A + 2, SHARES + 3, SHARES + 3, R).
    """

    parameters: dict[str, Any]
    digest: str
    radii: Array
    pair_radii: Array
    delta: Array
    polar: Array
    fields: Mapping[str, Array]
    arrays: Mapping[str, Array]

    def tables(self, radius: float, *, pairs: bool = True) -> Tables:
        """Return the tables of one tip.

        Args:
            radius: Radius of the tip, mm.
            pairs: Whether to include the corrections for pairs.

        Raises:
            UserError: The radius is not between SMALLEST_MM and LARGEST_MM.
        """
        if not SMALLEST_MM <= radius <= LARGEST_MM:
            raise UserError(
                f"the tip's radius is {radius:g} mm; the simulator has tables for {SMALLEST_MM:g} "
                f"to {LARGEST_MM:g} mm. Take such a tip, or finite elements: "
                "`--param sensor.tier=fem`."
            )
        end = deepest(radius)
        delta = np.linspace(0.0, end, math.ceil(end / float(self.delta[1]) - 1e-9) + 1)
        fields = {}
        for name in QUANTITIES:
            field = between(self.radii, self.fields[name], radius)
            fields[name] = CubicSpline(self.delta, field, axis=0)(delta)
        return Tables(
            {**self.parameters, "radius": radius},
            data_file.digest_of({}, f"{self.digest} {radius!r}"),
            {radius: Table(radius, delta, self.polar, fields)},
            self._corrections(radius, end, pairs),
        )

    def _corrections(self, radius: float, end: float, pairs: bool) -> Corrections:
        grid = {
            **self.parameters["corrections"],
            "around_radii": [radius],
            "pair_radius": radius,
            "depth_step": end / SHARES,
        }
        arrays = {name: mode for name, mode in self.arrays.items() if not name.endswith("amounts")}
        around = between(self.radii, self.arrays["around_amounts"], radius)
        arrays["around_amounts"] = around[None]
        if pairs:
            arrays["pair_amounts"] = between(self.pair_radii, self.arrays["pair_amounts"], radius)
        return Corrections(arrays, grid)


def between(radii: Array, values: Array, radius: float) -> Array:
    """Return values at one radius, by a cubic spline in log R; a node is met exactly.

    Args:
        radii: (K,) nodes, mm.
        values: (K, ...) values at the nodes.
        radius: Radius, mm.
    """
    rows = np.flatnonzero(radii == radius)
    if len(rows):
        return np.asarray(values[rows[0]], dtype=np.float64)
    spline = CubicSpline(np.log(radii), values, axis=0)
    return np.asarray(spline(math.log(radius)), dtype=np.float64)


def _tip_tables(arrays: data_file.Arrays, parameters: dict[str, Any], digest: str) -> TipTables:
    fields = {
        name: arrays[name].astype(np.float64) * (1.0 if name == "force" else QUANTUM)
        for name in QUANTITIES
    }
    rest = {
        name: values.astype(np.float64)
        for name, values in arrays.items()
        if name.startswith(("around_", "pair_")) and name != "pair_radii"
    }
    radii, pair_radii, delta, polar = (
        arrays[name].astype(np.float64) for name in ("radii", "pair_radii", "delta", "polar")
    )
    return TipTables(parameters, digest, radii, pair_radii, delta, polar, fields, rest)


DATA = data_file.DataFile(__package__, FILE, "the tables of other tips", _tip_tables, SCRIPT)
read, shipped = DATA.read, DATA.shipped
