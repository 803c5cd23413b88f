"""Tables of sideways drag: what the skin does when a tip that sticks to it is pulled sideways.

A tip presses the apex and is pulled along the skin. For each unit of sideways force the skin moves
by a field that is proportional to cos(phi) inward (W) and away from the contact (A) and to sin(phi)
along the circles around it (V), with phi measured from the direction of the pull. The file has
these fields for some radii and depths, from three-dimensional finite elements; between radii they
are splines in log R at one share of the greatest depth. The skin under the tip moves by the
compliance times the force.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from tactibench import UserError
from tactibench_sim import data_file
from tactibench_sim.mechanics.tip_tables import between, deepest

Array = npt.NDArray[np.float64]
FILE = "drag.npz"
SCRIPT = "scripts/fem/tabulate_drag.py"
"""Script that makes the file; it is in the repository and not in the package."""
SHARES = (0.05, 0.125, 0.25, 0.375, 0.5, 0.65, 0.8, 1.0)
"""Depths of the runs, in shares of each tip's greatest. Below the first one its field is taken: the
friction that can pull a light contact is small, whatever the skin does for each unit of it."""
QUANTITIES = 5
DEPTH_NODES, POLAR_STEP_DEG = 65, 0.5
"""Fineness of the tables that are looked up linearly."""


@dataclass(frozen=True, eq=False)
class TipDrag:
    """The response of both skins to a unit of sideways force of one tip, E_skin mm^2.

    Depths and polar angles are uniform, from 0.

    Attributes:
        inner: (D, T, 5) W, A, V of the inner skin, mm, and two turns of its normal, rad.
        outer: (D, T, 5) likewise of the outer skin, whose turns are 0.
        compliance: (D,) ways of the skin under the tip, mm.
        depth_step: Step of the depths, mm.
        polar_step: Step of the polar angles, rad.
    """

    inner: Array
    outer: Array
    compliance: Array
    depth_step: float
    polar_step: float

    @property
    def deepest(self) -> float:
        """Greatest tabulated penetration, mm."""
        return self.depth_step * (len(self.compliance) - 1)

    def compliance_at(self, depth: Array) -> Array:
        """Return how far a unit of force moves the skin under the tip, mm, at depths, mm."""
        nodes = self.depth_step * np.arange(len(self.compliance))
        return np.asarray(np.interp(depth, nodes, self.compliance), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class DragTables:
    """The content of a file of drag.

    Attributes:
        parameters: Parameters of the finite-element runs, ``dome`` among them.
        digest: Checksum of the file.
        radii: (K,) radii, mm, the last one of a plate.
        ends: (K,) greatest depths, mm.
        field: (K, D, 2, 3, T) W, A, V of the inner and the outer skin at SHARES of the depth.
        compliance: (K, D) ways of the skin under the tip, mm.
    """

    parameters: dict[str, Any]
    digest: str
    radii: Array
    ends: Array
    field: Array
    compliance: Array

    def tip(self, radius: float) -> TipDrag:
        """Return the tables of a tip.

        Args:
            radius: Radius, mm; inf for a plate.

        Raises:
            UserError: The radius lies outside of those of the file.
        """
        shares = np.array(SHARES)
        rows = np.flatnonzero(self.radii == radius)
        if len(rows):
            k = int(rows[0])
            return self._fine(float(self.ends[k]), shares, self.field[k], self.compliance[k])
        spheres = np.flatnonzero(np.isfinite(self.radii)).tolist()
        low, high = self.radii[spheres[0]], self.radii[spheres[-1]]
        if not low <= radius <= high:
            raise UserError(
                f"a tip of R = {radius:g} mm moves sideways; the simulator has tables of drag for "
                f"{low:g} to {high:g} mm. Take such a tip, or leave sensor.friction out."
            )
        at_share = [self._at_shares(k, deepest(float(self.radii[k]))) for k in spheres]
        field = between(self.radii[spheres], np.stack([f for f, _ in at_share]), radius)
        compliance = between(self.radii[spheres], np.stack([c for _, c in at_share]), radius)
        return self._fine(deepest(radius), shares, field, compliance)

    def _at_shares(self, k: int, end: float) -> tuple[Array, Array]:
        """Return field and compliance of one radius at SHARES of another greatest depth."""
        nodes, wanted = self.ends[k] * np.array(SHARES), end * np.array(SHARES)
        wanted = wanted.clip(nodes[0])
        return (
            CubicSpline(nodes, self.field[k])(wanted),
            CubicSpline(nodes, self.compliance[k])(wanted),
        )

    def _fine(self, end: float, shares: Array, field: Array, compliance: Array) -> TipDrag:
        depth = np.linspace(0.0, end, DEPTH_NODES)
        at = depth.clip(end * shares[0])
        coarse = np.radians(self.parameters["polar_step_deg"]) * np.arange(field.shape[-1])
        polar = np.radians(POLAR_STEP_DEG) * np.arange(round(90 / POLAR_STEP_DEG) + 1)
        along = CubicSpline(coarse, CubicSpline(end * shares, field)(at), axis=-1)
        skins = np.moveaxis(along(polar), -1, 2)  # (D, 2, T, 3)
        slope = along(polar, 1)[:, 0, 0]
        inner = self._with_turns(skins[:, 0], slope, polar)
        outer = np.concatenate([skins[:, 1], np.zeros((*skins.shape[:1], len(polar), 2))], axis=-1)
        softness = CubicSpline(end * shares, compliance)(at)
        return TipDrag(
            inner, np.ascontiguousarray(outer), softness, float(depth[1]), float(polar[1])
        )

    def _with_turns(self, skin: Array, slope: Array, polar: Array) -> Array:
        """Return (D, T, 5): W, A, V and the turns (W' + A) / r and (V - W / sin) / r."""
        w, a, v = np.moveaxis(skin, -1, 0)
        dome = self.parameters["dome"]
        radius = float(dome["outer"] - dome["skin"])
        ratio = np.divide(w, np.sin(polar), out=np.zeros_like(w), where=polar > 0)
        ratio[:, 0] = slope[:, 0]
        turns = (slope + a) / radius, (v - ratio) / radius
        return np.ascontiguousarray(np.stack([w, a, v, *turns], axis=-1))


def _tables(arrays: data_file.Arrays, parameters: dict[str, Any], digest: str) -> DragTables:
    radii, ends = (arrays[name].astype(np.float64) for name in ("radii", "deepest"))
    field, compliance = (arrays[name].astype(np.float64) for name in ("field", "compliance"))
    return DragTables(parameters, digest, radii, ends, field, compliance)


DATA = data_file.DataFile(__package__, FILE, "the tables of sideways drag", _tables, SCRIPT)
read, shipped = DATA.read, DATA.shipped


@cache
def drag_of(radius: float) -> TipDrag:
    """Return the shipped tables of one tip."""
    return shipped().tip(radius)
