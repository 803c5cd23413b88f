"""Where the pin tips go: single-contact fields, rotated to each contact and added up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactibench import UserError
from tactibench_sim.contact import Tips, check_reach
from tactibench_sim.coupling import couple, superpose
from tactibench_sim.spline import Array, Index, PolarTables
from tactibench_sim.table import Tables

TIERS = ("coupled", "superpose")


@dataclass(frozen=True, eq=False)
class Loads:
    """Amplitudes a and shape depths s (S, K) at directions n (S, K, 3); table: (S,) index."""

    n: Array
    amplitude: Array
    shape: Array
    table: Index


class Mechanics:
    """The dome: loads of presses, the pins' tips and the outer skin's displacement."""

    def __init__(self, tables: Tables, tier: str) -> None:
        if tier not in TIERS:
            raise UserError(f"the tier is {tier!r}; allowed: {', '.join(TIERS)}.")
        self.radii = tuple(sorted(tables.by_radius))
        ordered = [tables.by_radius[radius] for radius in self.radii]
        grid = ordered[0].delta, ordered[0].polar
        self.deepest = ordered[0].deepest
        self.inner = float(tables.parameters["dome"]["outer"] - tables.parameters["dome"]["skin"])
        self.tier = tier
        sine = np.sin(grid[1])
        self._base = PolarTables(
            *grid,
            [
                [t.fields["w"], _over(t.fields["t"], sine), _over(t.fields["omega"], sine)]
                for t in ordered
            ],
        )
        self._skin = PolarTables(*grid, [[t.fields["w_outer"]] for t in ordered])

    def loads(self, tips: Tips) -> Loads:
        """Who carries how much. Raises UserError for tips that the tables do not reach."""
        table = np.searchsorted(self.radii, tips.radius).clip(max=len(self.radii) - 1)
        known = np.array(self.radii)[table] == tips.radius
        if not known.all():
            there = ", ".join("plate" if np.isinf(r) else f"{r:g} mm" for r in self.radii)
            raise UserError(
                f"the indenter's radius is {tips.radius[~known][0]:g} mm; "
                f"the simulator has tables for: {there}."
            )
        n, delta = tips.directions()
        check_reach(n, delta, self.deepest)
        if self.tier == "superpose":
            return Loads(n, *superpose(delta), table)
        return Loads(n, *couple(self._skin, table, n, delta), table)

    def displacement(self, loads: Loads, directions: Array) -> tuple[Array, Array]:
        """Displacement u of pin bases, mm, and turn q of their normals, rad; both (S, P, 3).

        directions: (P, 3) unit vectors from the dome's centre. The normal b turns by |q| towards q.
        """
        count = len(loads.table), len(directions), 3
        u, q = np.zeros(count), np.zeros(count)
        for k in range(loads.amplitude.shape[1]):
            rows = np.flatnonzero(loads.amplitude[:, k])
            if not len(rows):
                continue
            n = loads.n[rows, k]
            meridian = self._base.at_depth(
                loads.table[rows], loads.shape[rows, k], loads.amplitude[rows, k]
            )
            cosine = _dot(n, directions)
            w, t, omega = np.moveaxis(self._base.at_polar(meridian, np.arccos(cosine)), -1, 0)
            # b cos - n is the tangent away from the contact times sin, which t and omega lack
            away = directions * cosine[..., None] - n[:, None, :]
            u[rows] += t[..., None] * away - w[..., None] * directions
            q[rows] += omega[..., None] * away
        return u, q

    def pin_tips(self, loads: Loads, directions: Array, length: float) -> Array:
        """(S, P, 3) tips of pins of ``length`` mm, from the dome's centre, mm."""
        u, q = self.displacement(loads, directions)
        angle = np.sqrt((q * q).sum(axis=-1, keepdims=True))
        normal = directions * np.cos(angle) + q * np.sinc(angle / np.pi)
        tips: Array = self.inner * directions + u - length * normal
        return tips

    def skin(self, loads: Loads, directions: Array) -> Array:
        """(S, P) inward displacement of the outer skin, mm."""
        out = np.zeros((len(loads.table), len(directions)))
        for k in range(loads.amplitude.shape[1]):
            rows = np.flatnonzero(loads.amplitude[:, k])
            meridian = self._skin.at_depth(
                loads.table[rows], loads.shape[rows, k], loads.amplitude[rows, k]
            )
            polar = np.arccos(_dot(loads.n[rows, k], directions))
            out[rows] += self._skin.at_polar(meridian, polar)[..., 0]
        return out


def _dot(n: Array, b: Array) -> Array:
    """(C, P) cosines. Written out: a matrix product may round differently in other batch sizes."""
    product = n[:, None, 0] * b[:, 0] + n[:, None, 1] * b[:, 1] + n[:, None, 2] * b[:, 2]
    cosine: Array = np.clip(product, -1.0, 1.0)
    return cosine


def _over(field: Array, sine: Array) -> Array:
    """An odd field divided by sin: even and smooth, its value on the axis from its neighbours."""
    out = np.empty_like(field)
    out[:, 1:] = field[:, 1:] / sine[1:]
    out[:, 0] = (15 * out[:, 1] - 6 * out[:, 2] + out[:, 3]) / 10  # even quartic through three
    return out
