"""Limits of a sensor over a workspace: of locating a contact, and of telling two tips from one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactibench.contacts import FloatArray, Grid, Indenter, Pose, Scene
from tactibench.errors import UserError
from tactibench.frames import spacing_limit
from tactibench.geometry import tip_positions
from tactibench.plugins import Sensor

AXES = ("x", "y", "depth")
SEPARATION = "separation"
TWO_FROM_ONE = "two from one"
"""Quantity of the spacing from which two tips are told from one."""
FARTHEST_MM = 100.0
"""Bounds larger than this count as infinite: the information left in them is rounding."""
PLACES = 5
"""Places along one side at which two tips are told from one; that takes 40 times as long as a
bound."""


@dataclass(frozen=True)
class LimitRequest:
    """Presses of one indenter at every cell of a grid and every depth.

    Attributes:
        indenter: Indenter that presses.
        grid: Places of the presses.
        depths: Depths of the presses, mm.
        yaw: Turn of the indenter, deg.
        nuisances: Names of what the bound takes as unknown.
    """

    indenter: Indenter
    grid: Grid
    depths: tuple[float, ...]
    yaw: float = 0.0
    nuisances: tuple[str, ...] = ()

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the quantities: x, y, depth, and the distance of the tips if there are two."""
        return (*AXES, SEPARATION) if len(self.indenter.offsets) == 2 else AXES

    @property
    def presses(self) -> int:
        """Number of presses: every cell of the grid at every depth."""
        return len(self.depths) * self.grid.shape[0] * self.grid.shape[1]

    @property
    def coarse(self) -> Grid:
        """The grid of the two-point limit.

        It has at most PLACES x PLACES cells of the grid, evenly spaced around its middle.
        """
        half = [cells // 2 for cells in self.grid.shape]
        stride = max(1, -(-max(half) // (PLACES // 2)))
        rows, columns = (2 * (h // stride) + 1 for h in half)
        x, y = self.grid.axes()
        first = half[0] - stride * (rows // 2), half[1] - stride * (columns // 2)
        return Grid((rows, columns), (x[first[1]], y[first[0]]), stride * self.grid.pitch)


@dataclass(frozen=True, eq=False)
class LimitMaps:
    """Smallest standard deviations, mm, on the grid of a request.

    Attributes:
        request: The request.
        values: (depths, quantities, rows, columns) mm; inf: the frame holds no information, or a
            tip does not touch; nan: the sensor refuses the press.
        refusal: First message with which the sensor refused a press; "": none was refused.
        spacings: (depths, rows, columns) mm on ``request.coarse``: the spacing from which two tips
            differ from one; inf and nan as in ``values``; None: the indenter has not two tips, or
            the sensor does not know.
    """

    request: LimitRequest
    values: FloatArray
    refusal: str = ""
    spacings: FloatArray | None = None


def map_limits(sensor: Sensor, request: LimitRequest, advance: Callable[[int], None]) -> LimitMaps:
    """Return the bounds of the sensor for every press.

    Args:
        sensor: The sensor.
        request: The presses.
        advance: Called with 1 after every press.

    Raises:
        UserError: The sensor refuses all presses.
    """
    values = np.full((len(request.depths), len(request.quantities), *request.grid.shape), np.nan)
    refusals: list[str] = []
    for (d, i, j), scene in _scenes(request, request.grid):
        try:
            values[d, :, i, j] = limits_of(sensor, scene, request.nuisances)
        except UserError as error:
            refusals.append(str(error))
        advance(1)
    if len(refusals) == request.presses:
        raise UserError(refusals[0])
    return LimitMaps(request, values, next(iter(refusals), ""), _map_spacings(sensor, request))


def _scenes(request: LimitRequest, grid: Grid) -> Iterator[tuple[tuple[int, ...], Scene]]:
    """Yield the place (depth, row, column) of every press on a grid, and its scene."""
    x, y = grid.axes()
    for d, i, j in np.ndindex(len(request.depths), *grid.shape):
        pose = Pose(float(x[j]), float(y[i]), request.yaw, 0.0, request.depths[d])
        yield (d, i, j), Scene(request.indenter, pose)


def _map_spacings(sensor: Sensor, request: LimitRequest) -> FloatArray | None:
    """Return the spacings of ``LimitMaps``."""
    if len(request.indenter.offsets) != 2:
        return None
    spacings = np.full((len(request.depths), *request.coarse.shape), np.nan)
    for place, scene in _scenes(request, request.coarse):
        try:
            limit = spacing_limit(sensor, scene, request.nuisances)
        except UserError:
            continue
        if limit is None:
            return None
        spacings[place] = limit
    return spacings


def limits_of(sensor: Sensor, scene: Scene, nuisances: Sequence[str]) -> list[float]:
    """Return the bounds of x, y, depth of the worst contact, mm, and of the separation of two tips.

    All are inf when a tip does not touch: the frame holds no information on it.

    Raises:
        UserError: The sensor refuses the press.
    """
    tips = len(scene.indenter.offsets)
    covariance = sensor.covariance(scene, nuisances)
    if covariance is None or len(covariance) < 3 * tips:
        return [np.inf] * (3 + (tips == 2))
    bounds = [*np.sqrt(np.diag(covariance)).reshape(tips, 3).max(axis=0)]
    if tips == 2:
        first, second = tip_positions(scene)[:, :2]
        bounds.append(separation_limit(covariance, first - second))
    return [bound if bound < FARTHEST_MM else np.inf for bound in bounds]


def separation_limit(covariance: FloatArray, apart: FloatArray) -> float:
    """Return the standard deviation of |p1 - p2|, mm, of two contacts.

    With u the direction of p1 - p2, var |p1 - p2| = g C g for g = (u, 0, -u, 0).

    Args:
        covariance: C, (6, 6) covariance of x, y, depth of both contacts, mm^2.
        apart: (2,) p1 - p2, mm.

    Returns:
        inf where a coordinate along u has no bound.
    """
    u = apart / np.linalg.norm(apart)
    g = np.array([*u, 0.0, *-u, 0.0])
    asked = np.abs(g) > 1e-12
    if np.isinf(np.diag(covariance)[asked]).any():
        return float("inf")
    part = covariance[np.ix_(asked, asked)]
    return float(np.sqrt(max(g[asked] @ part @ g[asked], 0.0)))


def summary(maps: LimitMaps) -> list[dict[str, Any]]:
    """Return one line for every depth and quantity, then those of TWO_FROM_ONE.

    Each holds the bound in the middle of the workspace, median, 90 % quantile, largest bound and
    counts. Quantiles are over the n presses that have a bound; "unbounded" and "refused" count the
    others. "worst_at" is the place (x, y) of the largest bound, mm.
    """
    request, spacings = maps.request, () if maps.spacings is None else maps.spacings
    return [
        _summary_line(layer, request.grid, depth, quantity)
        for depth, layers in zip(request.depths, maps.values, strict=True)
        for quantity, layer in zip(request.quantities, layers, strict=True)
    ] + [
        _summary_line(layer, request.coarse, depth, TWO_FROM_ONE)
        for depth, layer in zip(request.depths, spacings, strict=False)
    ]


def _summary_line(layer: FloatArray, grid: Grid, depth: float, quantity: str) -> dict[str, Any]:
    middle = grid.shape[0] // 2, grid.shape[1] // 2
    bounded = np.where(np.isfinite(layer), layer, -np.inf)
    n = int(np.isfinite(layer).sum())
    line = {
        "depth": depth,
        "quantity": quantity,
        "middle": float(layer[middle]),
        "n": n,
        "unbounded": int(np.isinf(layer).sum()),
        "refused": int(np.isnan(layer).sum()),
    }
    if n:
        half, most = np.quantile(layer[np.isfinite(layer)], [0.5, 0.9])
        place = np.unravel_index(int(bounded.argmax()), layer.shape)
        at = tuple(round(float(c), 6) for c in grid.xy(*place))
        line |= {
            "median": float(half),
            "p90": float(most),
            "worst": float(layer[place]),
            "worst_at": at,
        }
    return line


def limit_rows(maps: LimitMaps) -> list[dict[str, Any]]:
    """Return tidy rows with metric, group, value (None: no bound), unit and n.

    Further rows hold the shares of presses that are unbounded or refused.
    """
    rows: list[dict[str, Any]] = []
    for line in summary(maps):
        group, quantity = f"depth {line['depth']:g} mm", line["quantity"]
        metric = "limit" if quantity == TWO_FROM_ONE else f"bound_{quantity}"
        total = line["n"] + line["unbounded"] + line["refused"]
        ends = {name: line.get(name, np.inf) for name in ("middle", "median", "p90", "worst")}
        cells = [
            *((f"{metric}_mm", f"{group}, {name}", v, "mm", line["n"]) for name, v in ends.items()),
            *(
                (f"{metric}_{state}", group, line[state] / total, "share", total)
                for state in ("unbounded", "refused")
            ),
        ]
        for name, where, value, unit, n in cells:
            finite = float(value) if np.isfinite(value) else None
            rows.append({"metric": name, "group": where, "value": finite, "unit": unit, "n": n})
    return rows
