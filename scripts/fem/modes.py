"""Modes of the tables' corrections: patches on a chart, their splines and singular vectors.

See ``tactibench_sim.mechanics.corrections`` for what a patch is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.ndimage import map_coordinates, spline_filter1d

from tactibench_sim.mechanics.finite_elements import turn

Array = npt.NDArray[np.float64]
FOUR = 4
"""Modes come in fours, because ``kernels.blend`` takes four at a time."""
_REFLECTED = 12  # nodes of odd reflection; the effect of the border falls to 0.27 with each node


@dataclass(frozen=True)
class Cells:
    """Nodes of a patch on a uniform grid of coordinates a (along e) and b (along f), in chords.

    Attributes:
        start: First node along e, chords.
        along: Number of nodes along e.
        across: Number of nodes along f; the first one is at 0.
        step: Distance of two nodes, chords.
        fade: Number of steps at the border over which corrections fade to 0.
        closed: Whether corrections fade to 0 at the start of a, too.
    """

    start: float
    along: int
    across: int
    step: float
    fade: int
    closed: bool

    @property
    def a(self) -> Array:
        """Nodes along e, chords."""
        return np.asarray(self.start + np.arange(self.along) * self.step, dtype=np.float64)

    @property
    def b(self) -> Array:
        """Nodes along f, chords."""
        return np.asarray(np.arange(self.across) * self.step, dtype=np.float64)

    def window(self) -> Array:
        """Return the (A, B) weights of the nodes: 1 inside, falling smoothly to 0 at the border."""
        a, b = np.arange(self.along), np.arange(self.across)
        inside = self.along - 1 - a
        if self.closed:
            inside = np.minimum(a, inside)
        left = np.minimum(inside[:, None], (self.across - 1 - b)[None, :])
        x = np.clip(left / self.fade, 0.0, 1.0)
        return np.asarray(x * x * (3 - 2 * x), dtype=np.float64)

    def places(self) -> tuple[Array, Array]:
        """Return the (A, B) azimuthal-equidistant coordinates a and b of the nodes, deg."""
        a, b = np.meshgrid(self.a, self.b, indexing="ij")
        chord = np.minimum(np.hypot(a, b), 2.0)
        half = np.arcsin(chord / 2)
        stretch = np.degrees(2 * half / np.maximum(chord, 1e-300))
        stretch = np.where(chord > 0, stretch, np.degrees(1.0))
        return a * stretch, b * stretch


@dataclass(frozen=True)
class Chart:
    """Places where runs are sampled, azimuthal-equidistant around a middle direction.

    Attributes:
        start: First node along e, deg.
        reach: Last node along e, deg.
        across: Last node along f, deg; the first one is at 0.
        step: Distance of two nodes, deg.
    """

    start: float
    reach: float
    across: float
    step: float

    @property
    def a(self) -> Array:
        """Nodes along e, deg."""
        count = round((self.reach - self.start) / self.step) + 1
        return np.asarray(self.start + np.arange(count) * self.step, dtype=np.float64)

    @property
    def b(self) -> Array:
        """Nodes along f, deg."""
        count = round(self.across / self.step) + 1
        return np.asarray(np.arange(count) * self.step, dtype=np.float64)

    def directions(self) -> Array:
        """Return the (A, B, 3) unit vectors of the nodes, by components along e, f, m."""
        a, b = np.meshgrid(np.radians(self.a), np.radians(self.b), indexing="ij")
        r = np.hypot(a, b)
        stretch = np.sinc(r / np.pi)
        return np.stack([a * stretch, b * stretch, np.cos(r)], axis=-1)

    def normals(self, positions: Array) -> Array:
        """Return the (..., A, B, 3) outward normals of a displaced surface.

        Args:
            positions: (..., A, B, 3) positions of the nodes, symmetric about b = 0, mm.
        """
        mirrored = positions[..., :0:-1, :] * [1.0, -1.0, 1.0]
        symmetric = np.concatenate([mirrored, positions], axis=-2)
        nodes = np.concatenate([-self.b[:0:-1], self.b])
        along = CubicSpline(self.a, symmetric, axis=-3)(self.a, 1)
        across = CubicSpline(nodes, symmetric, axis=-2)(nodes, 1)
        normal = np.cross(along, across)[..., len(self.b) - 1 :, :]
        out: Array = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
        return out


def modes_of(snapshots: Array, most: int) -> tuple[Array, Array]:
    """Return amounts (N, R) and modes (R, ...): the leading singular vectors of snapshots.

    Args:
        snapshots: (N, ...) fields.
        most: Largest R, a multiple of FOUR. R is the largest multiple of FOUR that the number of
            singular values allows.
    """
    flat = snapshots.reshape(len(snapshots), -1)
    left, values, right = np.linalg.svd(flat, full_matrices=False)
    rank = min(most, FOUR * (len(values) // FOUR))
    amounts = left[:, :rank] * values[:rank]
    return amounts, right[:rank].reshape(rank, *snapshots.shape[1:])


def on_cells(values: Array, chart: Chart, cells: Cells) -> Array:
    """Return the fields of a chart at the nodes of cells, faded out at the cells' border.

    Args:
        values: (..., A, B, C) fields at the nodes of the chart. C counts the components along
            e, f, m of one or more vectors; the second component of each is odd in b.
        chart: Places where the fields are given.
        cells: Places where the fields are wanted.
    """
    odd = np.where(np.arange(values.shape[-1]) % 3 == 1, -1.0, 1.0)
    symmetric = np.concatenate([values[..., :0:-1, :] * odd, values], axis=-2)
    a, b = cells.places()
    place = (a - chart.start) / chart.step, b / chart.step + len(chart.b) - 1
    flat = np.moveaxis(symmetric, -1, -3).reshape(-1, *symmetric.shape[-3:-1])
    nodes = np.stack(
        [map_coordinates(component, place, order=3, mode="nearest") for component in flat]
    )
    nodes = nodes.reshape(*values.shape[:-3], values.shape[-1], *a.shape) * cells.window()
    return np.moveaxis(nodes, -3, -1)


def six(chart: Chart, radius: float, displacement: Array) -> Array:
    """Return the (..., A, B, 6) displacement, mm, and turn of the normal of a sphere's surface.

    Args:
        chart: Places of the nodes.
        radius: Radius of the sphere, mm.
        displacement: (..., A, B, 3) displacement of the nodes along e, f, m, mm.
    """
    directions = chart.directions()
    normals = chart.normals(radius * directions + displacement)
    return np.concatenate([displacement, turn(directions, normals)], axis=-1)


def resampled(nodes: Array, values: Array, axis: int, count: int, step: float) -> Array:
    """Return values at ``count`` nodes 0, step, 2 step, ... by a cubic spline along an axis.

    Args:
        nodes: Places of the given values along the axis.
        values: Values at the nodes.
        axis: Axis of ``values`` along which the nodes lie.
        count: Number of new nodes.
        step: Distance of two new nodes.
    """
    out: Array = CubicSpline(nodes, values, axis=axis)(np.arange(count) * step)
    return out


def coefficients(values: Array, axes: Sequence[int]) -> Array:
    """Return cubic B-spline coefficients on uniform nodes, one more at each end of every axis.

    The ends are natural: the second derivative vanishes there.
    """
    out = np.asarray(values, dtype=np.float64)
    for axis in axes:
        margin = min(_REFLECTED, out.shape[axis] - 1)
        width = [(margin, margin) if k == axis else (0, 0) for k in range(out.ndim)]
        longer = np.pad(out, width, mode="reflect", reflect_type="odd")
        filtered = spline_filter1d(longer, 3, axis=axis, mode="mirror")
        keep = [slice(None)] * out.ndim
        keep[axis] = slice(margin - 1, filtered.shape[axis] - margin + 1)
        out = filtered[tuple(keep)]
    return np.ascontiguousarray(out)
