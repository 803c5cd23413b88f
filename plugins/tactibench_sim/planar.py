"""The simulated planar sensor: a flat gel pad, a square grid of markers, a camera below.

A table file holds, by ``[radius, depth, distance from the tip's axis]``: displacement ``w`` into
the pad and ``t`` away from the axis of the markers, ``w_surface`` and ``t_surface`` of the surface,
mm; by ``[radius, depth]``: ``force`` (E_gel mm^2, of a pad with a skin E_skin mm^2).

The field of a press is the sum over its tips of a_i T(|x - x_i|; s_i), T the tabulated field of one
tip. Tier "superpose": a_i = 1, s_i the tip's depth. Tier "coupled": effective depths with which
every tip reaches its depth or does not touch (``planar_kernels.couple``). The pad is wider than its
deformation, so the fields do not include its edge.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from tactibench import Grid, Scene, SensorContext, UserError, __version__
from tactibench_sim import planar_kernels
from tactibench_sim.camera import PLANAR_GRID, optics_from
from tactibench_sim.contact import SLACK, Tips, check_poses, pose_arrays
from tactibench_sim.dome import TIERS
from tactibench_sim.instances import Spread, lost_pins, perturb
from tactibench_sim.kernels import REACH_MM as BULGE_MM
from tactibench_sim.renderer import Renderer
from tactibench_sim.sensor import FRAMES_PER_SECOND, SimulatedSensor
from tactibench_sim.tables import TableFile, read_file, shipped_file

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]
DEEPEST_MM = 100.0
"""A greater depth is a mistake in units; the tables refuse smaller ones that are too deep."""
MARKERS, PITCH_MM = 14, 1.5
"""Markers on a side of the grid, whose middle is under the origin, and distance of neighbours.
Simulations of a GelSight Mini have 1.33 and 1.48 mm (FOTS, ``params.py``: 26 and 29 px at 19.58
px/mm)."""
REACH_MM = 10.0
"""Distance from the middle, in x and in y, within which a tip may press. The pad is meant to be 40
mm wide, and its fields do not include its edge: a free edge 10 mm off all around moves the surface
by 0.01 mm within 5 mm of a tip of 3 mm at 1 mm depth, and by 0.02 mm beside the edge (finite
elements)."""
SPREAD = Spread(gel_mm=0.0, air_mm=0.02)
"""Ranges of the instances; the pad's thickness is that of its table in all of them, and the camera
sits within half a millimetre (assumed)."""


@dataclass(frozen=True, eq=False)
class PadLoads:
    """The tips of S presses and how strongly they press.

    Attributes:
        xy: (S, K, 2) places of the tips, mm.
        amplitude: (S, K) factors on the tabulated fields.
        shape: (S, K) depths whose tabulated fields the tips have, mm.
        table: (S,) indices of the tips' radius.
    """

    xy: Array
    amplitude: Array
    shape: Array
    table: Index


class PadMechanics:
    """The pad by tables: loads of presses, displacements of markers and surface.

    Raises:
        UserError: ``tier`` is none of TIERS.
    """

    def __init__(self, file: TableFile, tier: str = "coupled") -> None:
        if tier not in TIERS:
            raise UserError(f"the tier is {tier!r}; allowed: {', '.join(TIERS)}.")
        self.tier, fields = tier, file.arrays
        self.radii, self._delta, self._r = (fields[name] for name in ("radii", "delta", "r"))
        self.deepest = float(self._delta[-1])
        self._steps = np.array([self._delta[1], self._r[1]])
        self._markers = self._spline(fields["w"], fields["t"])
        self._surface = self._spline(fields["w_surface"], fields["t_surface"])
        self._depression = np.ascontiguousarray(self._surface[:, :, :, :1])

    def _spline(self, into: Array, away: Array) -> Array:
        """Return (M, D, T, 2, 4) values and derivatives of two quantities (M, D, T), even in r."""
        depth, r = self._delta, self._r
        values = np.stack([into, _over_r(away, r)], axis=-1)
        values[:, 0] = 0.0
        slope = CubicSpline(r, values, axis=2, bc_type=("clamped", "not-a-knot"))(r, 1)
        with_slope = np.stack([values, slope], axis=-1)
        rate = CubicSpline(depth, with_slope, axis=1)(depth, 1)
        return np.ascontiguousarray(np.concatenate([with_slope, rate], axis=-1))

    def loads(self, tips: Tips) -> PadLoads:
        """Solve for how the tips share the load.

        Raises:
            UserError: The tables have no such radius or do not reach so deep.
        """
        table = self._table_indices(tips.radius)
        delta = np.ascontiguousarray(tips.depth, dtype=np.float64)  # one compilation for all
        if (delta > self.deepest + SLACK).any():
            raise UserError(
                f"a tip is pressed {delta.max():.2f} mm into the pad; the simulator's tables end "
                f"at {self.deepest:g} mm, press less deep."
            )
        xy = np.ascontiguousarray(tips.xy, dtype=np.float64)
        if self.tier == "superpose":
            shape = np.maximum(delta, 0.0)
            return PadLoads(xy, (shape > 0).astype(np.float64), shape, table)
        amplitude, shape = np.empty_like(delta), np.empty_like(delta)
        planar_kernels.couple(
            self._depression, self._steps, table, xy, delta, BULGE_MM, amplitude, shape
        )
        return PadLoads(xy, amplitude, shape, table)

    def _table_indices(self, radius: Array) -> Index:
        table = np.searchsorted(self.radii, radius).clip(max=len(self.radii) - 1)
        missing = radius[self.radii[table] != radius]
        if len(missing):
            raise UserError(
                f"the indenter's radius is {missing[0]:g} mm; the planar sensor has tables for: "
                f"{', '.join(f'{r:g} mm' for r in self.radii)}. Press one of these, or make a "
                "table with scripts/fem/tabulate_presses.py and give it as sensor.table."
            )
        return table

    def markers(self, loads: PadLoads, xy: Array) -> Array:
        """Return the (S, P, 3) displacement of markers at xy (P, 2) at rest, mm.

        z points out of the pad.
        """
        return self._displacement(self._markers, loads, xy)

    def surface(self, loads: PadLoads, xy: Array) -> Array:
        """Return the (S, P, 3) displacement of the surface above xy (P, 2) at rest, mm."""
        return self._displacement(self._surface, loads, xy)

    def _displacement(self, tables: Array, loads: PadLoads, xy: Array) -> Array:
        out = np.zeros((len(loads.table), len(xy), 3))
        planar_kernels.displace(
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


def _over_r(field: Array, r: Array) -> Array:
    """Divide an odd field by r; the result is even, its value on the axis from its neighbours."""
    out = np.empty_like(field)
    out[..., 1:] = field[..., 1:] / r[1:]
    out[..., 0] = (15 * out[..., 1] - 6 * out[..., 2] + out[..., 3]) / 10  # even quartic
    return out


def pad_tips(scenes: Sequence[Scene], reach: float) -> Tips:
    """Return the tips of scenes; the depth of a tip is its travel past its own first touch.

    Args:
        scenes: S scenes.
        reach: Distance from the middle, in x and in y, within which a tip may press, mm.

    Raises:
        UserError: A pose is not finite, tilted or too deep, its depth is negative, the indenter is
            a plate, or a tip presses beyond ``reach``.
    """
    offsets, pose, radius = pose_arrays(scenes)
    check_poses(
        scenes,
        pose,
        (
            np.isinf(radius),
            "a plate would touch all of the flat pad at once, which the planar sensor does not "
            "simulate; press spherical tips or take a sensor with a dome.",
        ),
        (pose[:, 3] != 0, "the pose's tilt is {tilt:g} deg; spherical tips on the pad need 0."),
        (pose[:, 4] > DEEPEST_MM, "the pose's depth is {depth:g} mm; no pad is that thick."),
    )
    x, y, yaw, _, depth = (column[:, None] for column in pose[:, :5].T)
    cosine, sine = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
    dx, dy, height = np.moveaxis(offsets, -1, 0)
    xy = np.stack([x + cosine * dx - sine * dy, y + sine * dx + cosine * dy], axis=-1)
    tips = Tips(xy, depth - (height.max(axis=1, keepdims=True) - height), radius)
    far = (tips.depth > 0) & (abs(tips.xy).max(axis=-1) > reach)
    if far.any():
        x_mm, y_mm = tips.xy[far][0]
        raise UserError(
            f"a tip presses the pad at x {x_mm:.2f} mm, y {y_mm:.2f} mm; the simulator knows it "
            f"within {reach:g} mm of its middle, beyond which its edge matters: press nearer to it."
        )
    return tips


class PlanarGrid(SimulatedSensor):
    """A flat pad bonded to a window. The origin is the middle of its surface, z out of the pad."""

    dome_radius_mm = math.inf

    def __init__(
        self,
        context: SensorContext,
        *,
        tier: str = "coupled",
        table: str = "",
        instance: int = 0,
        **optical: Any,
    ) -> None:
        """Build the pad, its markers and its camera.

        Args:
            context: The seed of the noise.
            tier: How contacts share the load.
            table: Path of a file of single-tip fields; "": the one that ships.
            instance: Number of the sensor instance; 0: the nominal one.
            **optical: Parameters of ``optics_from``; the others are the preset's.
        """
        file = read_file(Path(table)) if table else shipped_file("pad.npz")
        self._file, self._pad = file, file.parameters["pad"]
        self.mechanics = PadMechanics(file, tier)
        self.deepest_mm = self.mechanics.deepest
        gel = replace(PLANAR_GRID, gel_mm=float(self._pad["thickness"]))
        self.instance = instance
        self.optics, _ = perturb(optics_from(gel, optical), 1.0, instance, SPREAD)
        self.lost = lost_pins(MARKERS**2, self.optics.pin_loss, instance)
        self.markers = square_grid(MARKERS, PITCH_MM)[~self.lost]
        renderer = Renderer(self.optics, self.optics.camera_distance_mm)
        height = np.full(len(self.markers), -self._pad["marker_depth"])
        super().__init__(context, renderer, np.column_stack([self.markers, height]))

    def indenter_tips(self, scenes: Sequence[Scene]) -> Tips:
        """Return the tips of scenes on the pad (``pad_tips``)."""
        return pad_tips(scenes, REACH_MM)

    def places(self, tips: Tips) -> Array:
        """Return the (S, P, 3) places of the markers, mm."""
        out = self.mechanics.markers(self.mechanics.loads(tips), self.markers)
        out[..., :2] += self.markers
        out[..., 2] -= self._pad["marker_depth"]
        return out

    def surface(self, scene: Scene, grid: Grid) -> Array:
        """Return the (H, W) displacement into the pad, mm, of the surface above cells at rest."""
        x, y = (axis.ravel() for axis in np.meshgrid(*grid.axes()))
        loads = self.mechanics.loads(self.indenter_tips([scene]))
        into: Array = -self.mechanics.surface(loads, np.stack([x, y], axis=1))[0, :, 2]
        return into.reshape(grid.shape)

    def describe(self) -> dict[str, Any]:
        """Return everything that determines the frames, except the seed."""
        return {
            "sensor": "planar-grid",
            "plugin": f"tactibench_sim {__version__}",
            "tier": self.mechanics.tier,
            "instance": self.instance,
            "markers": MARKERS**2,
            "lost_markers": np.flatnonzero(self.lost).tolist(),
            "pitch_mm": PITCH_MM,
            "optics": self.optics.describe(),
            "surface": "flat",
            "deepest_mm": self.deepest_mm,
            "reach_mm": REACH_MM,
            "tables": {**self._file.parameters, "sha256": self._file.digest},
            "frames_per_second": FRAMES_PER_SECOND,
        }


def square_grid(side: int, pitch: float) -> Array:
    """Return the (side^2, 2) places of a grid, mm, row by row along y, its middle at the origin."""
    steps = (np.arange(side) - (side - 1) / 2) * pitch
    x, y = np.meshgrid(steps, steps)
    return np.stack([x.ravel(), y.ravel()], axis=1)
