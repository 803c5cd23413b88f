"""How a pressed pad moves: loads of the tips, and displacements of its markers and surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from tactibench import UserError
from tactibench_sim.contact import Tips
from tactibench_sim.planar import kernels
from tactibench_sim.planar.table import PadTables

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]
TIERS = ("coupled", "superpose")
SLACK_MM = 0.01
"""How far bounds may step beyond the deepest table to take differences."""
REACH_MM = 1.0
"""Tips this far above the surface may still be met by a bulge (which is never that high)."""


@dataclass(frozen=True, eq=False)
class PadLoads:
    """Tips at xy (S, K, 2) mm press with amplitude times the shape of a depth, (S, K), mm.

    table: (S,) index of the tips' radius.
    """

    xy: Array
    amplitude: Array
    shape: Array
    table: Index


class PadMechanics:
    """The pad: loads of presses, displacements of markers and surface.

    The field of a press is the sum over its tips of a_i T(|x - x_i|; s_i), T the tabulated field of
    one tip. Tier "superpose": a_i = 1, s_i the tip's depth. Tier "coupled": effective depths with
    which every tip reaches its depth or stands clear (``kernels.couple``). The pad is wider than
    its deformation: fields do not know its edge.
    """

    def __init__(self, tables: PadTables, tier: str = "coupled") -> None:
        if tier not in TIERS:
            raise UserError(f"the tier is {tier!r}; allowed: {', '.join(TIERS)}.")
        self.tables, self.tier = tables, tier
        self._steps = np.array([tables.delta[1], tables.r[1]])
        fields = tables.fields
        self._markers = _spline(tables, [fields["w"], _over(fields["t"], tables.r)])
        self._surface = _spline(tables, [fields["w_surface"], _over(fields["t_surface"], tables.r)])
        self._depression = np.ascontiguousarray(self._surface[:, :, :, :1])

    def loads(self, tips: Tips) -> PadLoads:
        """Who carries how much. Raises UserError for tips that the tables do not hold."""
        table = self._table(tips.radius)
        delta = np.ascontiguousarray(tips.depth, dtype=np.float64)  # one compilation for all
        if (delta > self.tables.deepest + SLACK_MM).any():
            raise UserError(
                f"a tip is pressed {delta.max():.2f} mm into the pad; the simulator's tables end "
                f"at {self.tables.deepest:g} mm, press less deep."
            )
        xy = np.ascontiguousarray(tips.xy, dtype=np.float64)
        if self.tier == "superpose":
            shape = np.maximum(delta, 0.0)
            return PadLoads(xy, (shape > 0).astype(np.float64), shape, table)
        amplitude, shape = np.empty_like(delta), np.empty_like(delta)
        kernels.couple(self._depression, self._steps, table, xy, delta, REACH_MM, amplitude, shape)
        return PadLoads(xy, amplitude, shape, table)

    def _table(self, radius: Array) -> Index:
        radii = self.tables.radii
        table = np.searchsorted(radii, radius).clip(max=len(radii) - 1)
        known = radii[table] == radius
        if not known.all():
            there = ", ".join(f"{r:g} mm" for r in radii)
            wrong = radius[~known][0]
            raise UserError(
                f"the indenter's radius is {wrong:g} mm; the planar sensor has tables for: "
                f"{there}. Make one with `tactibench sim tabulate --planar --radius {wrong:g} "
                "FILE` and name it with --param sensor.table=FILE."
            )
        return table

    def markers(self, loads: PadLoads, xy: Array) -> Array:
        """(S, P, 3) displacement of markers at xy (P, 2) at rest, mm; z is out of the pad."""
        return self._displaced(self._markers, loads, xy)

    def surface(self, loads: PadLoads, xy: Array) -> Array:
        """(S, P, 3) displacement of the surface above xy (P, 2) at rest, mm."""
        return self._displaced(self._surface, loads, xy)

    def _displaced(self, tables: Array, loads: PadLoads, xy: Array) -> Array:
        out = np.zeros((len(loads.table), len(xy), 3))
        kernels.displace(
            tables,
            self._steps,
            loads.table,
            loads.xy,
            loads.amplitude,
            loads.shape,
            np.ascontiguousarray(xy, dtype=np.float64),
            out,
        )
        return out


def _spline(tables: PadTables, quantities: list[Array]) -> Array:
    """(M, D, T, Q, 4) values and derivatives of Q quantities (M, D, T), even in the distance."""
    values = np.stack(quantities, axis=-1)
    values[:, 0] = 0.0
    slope = CubicSpline(tables.r, values, axis=2, bc_type=("clamped", "not-a-knot"))(tables.r, 1)
    both = np.stack([values, slope], axis=-1)
    rate = CubicSpline(tables.delta, both, axis=1)(tables.delta, 1)
    return np.ascontiguousarray(np.concatenate([both, rate], axis=-1))


def _over(field: Array, r: Array) -> Array:
    """An odd field divided by r: even and smooth, its value on the axis from its neighbours."""
    out = np.empty_like(field)
    out[..., 1:] = field[..., 1:] / r[1:]
    out[..., 0] = (15 * out[..., 1] - 6 * out[..., 2] + out[..., 3]) / 10  # even quartic
    return out
