"""The displacement of a pressed pad, from tables of single tips.

A table file holds, by ``[radius, depth, distance from the tip's axis]``: displacement ``w`` into
the pad and ``t`` away from the axis of the markers, ``w_surface`` and ``t_surface`` of the surface,
mm; by ``[radius, depth]``: ``force`` (E_gel mm^2, of a pad with a skin E_skin mm^2).

The field of a press is the sum over its tips of a_i T(|x - x_i|; s_i), T the tabulated field of one
tip. Tier "superpose": a_i = 1, s_i the tip's depth. Tier "coupled": effective depths with which
every tip reaches its depth or does not touch (``kernels.couple``). The pad is wider than its
deformation, so the fields do not include its edge.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from tactibench import Scene, UserError
from tactibench_sim import data_file
from tactibench_sim.mechanics.contact import Tips, check_finite, pose_arrays
from tactibench_sim.mechanics.tables import SMALLEST_MM
from tactibench_sim.planar import kernels

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]
FILE = "pad.npz"
SCRIPT = "scripts/fem/tabulate_pad.py"
"""Script that makes the file; it is in the repository and not in the package."""
QUANTITIES = ("w", "t", "w_surface", "t_surface", "force")
TIERS = ("coupled", "superpose")
DEEPEST_MM = 100.0
"""A greater depth is a mistake in units; the tables refuse smaller ones that are too deep."""
SLACK_MM = 0.01
"""Distance by which bounds may step beyond the deepest table to take differences."""
REACH_MM = 1.0
"""Tips up to this far above the surface may be met by a bulge, which is never that high."""


@dataclass(frozen=True, eq=False)
class PadTables:
    """The content of a table file.

    Attributes:
        parameters: Parameters of the finite-element run, ``pad`` among them.
        digest: Checksum of the file.
        radii: (M,) radii of the tips, mm, ascending.
        delta: (D,) depths, mm, from 0, uniform.
        r: (T,) undeformed distances from the axis, mm, from 0, uniform.
        fields: Quantity -> (M, D, T), ``force`` -> (M, D).
    """

    parameters: dict[str, Any]
    digest: str
    radii: Array
    delta: Array
    r: Array
    fields: Mapping[str, Array]

    @property
    def thickness(self) -> float:
        """Thickness of the pad, mm."""
        return float(self.parameters["pad"]["thickness"])

    @property
    def marker_depth(self) -> float:
        """Depth of the markers below the surface, mm."""
        return float(self.parameters["pad"]["marker_depth"])

    @property
    def deepest(self) -> float:
        """Greatest tabulated depth, mm."""
        return float(self.delta[-1])


def _tables(arrays: data_file.Arrays, parameters: dict[str, Any], digest: str) -> PadTables:
    axes = {name: arrays[name].astype(np.float64) for name in ("radii", "delta", "r")}
    fields = {name: arrays[name].astype(np.float64) for name in QUANTITIES}
    return PadTables(parameters, digest, **axes, fields=fields)


DATA = data_file.DataFile(__package__, FILE, "the planar sensor's table", _tables, SCRIPT)
read, shipped = DATA.read, DATA.shipped


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

    def __init__(self, tables: PadTables, tier: str = "coupled") -> None:
        if tier not in TIERS:
            raise UserError(f"the tier is {tier!r}; allowed: {', '.join(TIERS)}.")
        self.tables, self.tier = tables, tier
        self._steps = np.array([tables.delta[1], tables.r[1]])
        fields = tables.fields
        self._markers = _spline(tables, [fields["w"], _over_r(fields["t"], tables.r)])
        self._surface = _spline(
            tables, [fields["w_surface"], _over_r(fields["t_surface"], tables.r)]
        )
        self._depression = np.ascontiguousarray(self._surface[:, :, :, :1])

    def loads(self, tips: Tips) -> PadLoads:
        """Solve for how the tips share the load.

        Raises:
            UserError: The tables have no such radius or do not reach so deep.
        """
        table = self._table_indices(tips.radius)
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

    def _table_indices(self, radius: Array) -> Index:
        radii = self.tables.radii
        table = np.searchsorted(radii, radius).clip(max=len(radii) - 1)
        has_table = radii[table] == radius
        if not has_table.all():
            available = ", ".join(f"{r:g} mm" for r in radii)
            missing = radius[~has_table][0]
            remedy = (
                f"Make one with `python {SCRIPT} OUT --radius {missing:g}` in the repository, then "
                "give `--param sensor.table=OUT`."
                if missing >= SMALLEST_MM
                else f"Press one of these; no table can be made below {SMALLEST_MM:g} mm."
            )
            raise UserError(
                f"the indenter's radius is {missing:g} mm; the planar sensor has tables for: "
                f"{available}. {remedy}"
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
    """Return (M, D, T, Q, 4) values and derivatives of Q quantities (M, D, T), even in r."""
    values = np.stack(quantities, axis=-1)
    values[:, 0] = 0.0
    slope = CubicSpline(tables.r, values, axis=2, bc_type=("clamped", "not-a-knot"))(tables.r, 1)
    with_slope = np.stack([values, slope], axis=-1)
    rate = CubicSpline(tables.delta, with_slope, axis=1)(tables.delta, 1)
    return np.ascontiguousarray(np.concatenate([with_slope, rate], axis=-1))


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
    for scene in scenes:
        _check(scene)
    offsets, pose, radius = pose_arrays(scenes)
    x, y, yaw, _, depth = (column[:, None] for column in pose.T)
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


def _check(scene: Scene) -> None:
    check_finite(scene)
    pose = scene.pose
    if scene.indenter.is_plate:
        raise UserError(
            "a plate would touch all of the flat pad at once, which the planar sensor does not "
            "simulate; press spherical tips or take a sensor with a dome."
        )
    if pose.tilt != 0:
        raise UserError(
            f"the pose's tilt is {pose.tilt:g} deg; spherical tips on the pad need tilt 0."
        )
    if pose.depth < 0:
        raise UserError(f"the pose's depth is {pose.depth:g} mm; it must be 0 or more.")
    if pose.depth > DEEPEST_MM:
        raise UserError(f"the pose's depth is {pose.depth:g} mm; no pad is that thick.")
