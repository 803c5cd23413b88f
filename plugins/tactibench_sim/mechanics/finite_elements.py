"""Tier ``fem``: a three-dimensional finite-element run of every scene, tens of seconds each.

From the tables it takes the dome's dimensions only: tips of any radius, contacts near the rim and
scenes of many tips are computed as they are. A sphere is the end of a rod along z.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench import UserError
from tactibench_sim import fem
from tactibench_sim.fem.field import SpatialField
from tactibench_sim.fem.press import Fineness, SpatialPress
from tactibench_sim.fem.tip import Tip
from tactibench_sim.mechanics.contact import Tips
from tactibench_sim.mechanics.kernels import REACH_MM
from tactibench_sim.mechanics.tables import Tables

Array = npt.NDArray[np.float64]
Sample = Callable[[SpatialField, Array], Array]
STEEPEST_DEG = 70.0
"""Polar angle beyond which a tip would press on the clamped rim itself."""


@dataclass(frozen=True, eq=False)
class FemLoads:
    """Solved scenes.

    Attributes:
        fields: One field a scene; None where nothing touches.
        azimuth: (S,) angles, rad, by which each scene was turned about z so that its tips stand on
            the x axis; 0 where they cannot.
    """

    fields: tuple[SpatialField | None, ...]
    azimuth: Array


class FemMechanics:
    """The dome of ``tables`` by finite elements, one run a scene.

    Raises:
        UserError: NGSolve is not installed.
    """

    tier = "fem"

    def __init__(self, tables: Tables, fineness: Fineness | None = None) -> None:
        fem.require_ngsolve()
        self.dome = fem.Dome(**tables.parameters["dome"])
        self.inner = self.dome.inner
        self.fineness = fineness

    def loads(self, tips: Tips) -> FemLoads:
        """Run every scene.

        Raises:
            UserError: A run does not converge, or a tip is too deep or too steep.
        """
        n, delta = tips.directions()
        self._check(n, delta)
        solved = [self._run(tips, delta[row], row) for row in range(len(tips))]
        return FemLoads(
            tuple(field for field, _ in solved), np.array([azimuth for _, azimuth in solved])
        )

    def displacement(self, loads: FemLoads, directions: Array) -> tuple[Array, Array]:
        """Return the displacement u of pin bases, mm, and the turn q of their normals, rad."""
        u = self._sample(loads, directions, SpatialField.inner, 0 * directions)
        normals = self._sample(loads, directions, SpatialField.inner_normals, directions)
        q = turn(directions, normals)
        q[[field is None for field in loads.fields]] = 0.0  # exactly
        return u, q

    def pin_tips(self, loads: FemLoads, directions: Array, length: float) -> Array:
        """Return the (S, P, 3) tips of pins of ``length`` mm, from the dome's centre, mm."""
        u = self._sample(loads, directions, SpatialField.inner, 0 * directions)
        normals = self._sample(loads, directions, SpatialField.inner_normals, directions)
        tips: Array = self.inner * directions + u - length * normals
        return tips

    def outer_displacement(self, loads: FemLoads, directions: Array) -> Array:
        """Return the (S, P, 3) displacement of the outer skin, mm."""
        return self._sample(loads, directions, SpatialField.outer, 0 * directions)

    def skin(self, loads: FemLoads, directions: Array) -> Array:
        """Return the (S, P) inward displacement of the outer skin, mm."""
        inward: Array = -(self.outer_displacement(loads, directions) * directions).sum(axis=-1)
        return inward

    def _sample(self, loads: FemLoads, directions: Array, method: Sample, rest: Array) -> Array:
        """Apply a method of SpatialField to S scenes; ``rest`` (P, 3) where nothing touches."""
        out = np.empty((len(loads.fields), *directions.shape))
        for row, (field, azimuth) in enumerate(zip(loads.fields, loads.azimuth, strict=True)):
            about = _about_z(azimuth)
            out[row] = rest if field is None else method(field, directions @ about) @ about.T
        return out

    def _check(self, n: Array, delta: Array) -> None:
        touching = delta > 0
        if not touching.any():
            return
        steepest = math.degrees(math.acos(min(max(float(n[..., 2][touching].min()), -1.0), 1.0)))
        if steepest > STEEPEST_DEG:
            raise UserError(
                f"a tip touches {steepest:.1f} deg from the apex; finite elements are run up to "
                f"{STEEPEST_DEG:g} deg: press nearer to the apex."
            )
        if delta.max() > self.dome.outer / 2:
            raise UserError(
                f"a tip penetrates {delta.max():.2f} mm; finite elements are run down to half the "
                f"dome's radius, {self.dome.outer / 2:g} mm: press less deep."
            )

    def _run(self, tips: Tips, delta: Array, row: int) -> tuple[SpatialField | None, float]:
        """Run one scene; return its field and the azimuth by which it was turned."""
        if not (delta > 0).any():
            return None, 0.0
        near = np.flatnonzero(delta > -REACH_MM)
        xy, depth, radius = tips.xy[row, near], tips.depth[row, near], float(tips.radius[row])
        far = xy[np.argmax((xy**2).sum(axis=1))]
        azimuth = math.atan2(far[1], far[0])
        along, across = (xy @ _about_z(azimuth)[:2, :2]).T
        mirror = bool((abs(across) < 1e-9).all())
        if mirror:
            xy = np.stack([along, 0 * along], axis=1)
        else:
            azimuth = 0.0
        depths = depth[None]
        try:
            press = SpatialPress(
                self.dome,
                [self._tip(x, y, radius) for x, y in xy],
                depths,
                mirror=mirror,
                fineness=self.fineness,
            )
            press.move(depths[0])
        except fem.NotConvergedError:
            raise UserError(
                f"the finite-element run of scene {row} did not converge on the way to "
                f"{depth.max():g} mm; press less deep or use another tier."
            ) from None
        return press.field(), azimuth

    def _tip(self, x: float, y: float, radius: float) -> Tip:
        if math.isfinite(radius):
            return Tip.downwards(self.dome, x, y, radius)
        height = math.sqrt(self.dome.outer**2 - x * x - y * y)
        return Tip.along_axis(self.dome, np.array([x, y, height]) / self.dome.outer, radius)


def turn(directions: Array, normals: Array) -> Array:
    """Return the rotation vectors q (..., 3), rad: the normal b has turned by |q| towards q.

    Args:
        directions: (..., 3) unit normals b before the turn.
        normals: (..., 3) unit normals after it.
    """
    up = (directions * normals).sum(axis=-1, keepdims=True)
    side = normals - up * directions
    sine = np.linalg.norm(side, axis=-1, keepdims=True)
    angle = np.arctan2(sine, up)
    out: Array = side * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 1.0)
    return out


def _about_z(azimuth: float) -> Array:
    """Return the (3, 3) matrix M for which v @ M turns row vectors v back by the azimuth."""
    c, s = math.cos(azimuth), math.sin(azimuth)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
