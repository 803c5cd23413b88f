"""Learn the corrections of a table file from finite-element runs.

O, the surroundings of one contact, is the run at a polar angle minus the run at the apex (both on
the same kind of mesh, so its error cancels). C, the pair, is the run with two contacts minus the
field that shared loads and O give. Both are reduced to a few modes whose amounts are splines of the
contact.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from modes import Cells, Chart, coefficients, modes_of, on_cells, resampled, six

from tactibench.geometry import DOME_RADIUS_MM
from tactibench_sim.mechanics.contact import Tips
from tactibench_sim.mechanics.corrections import Corrections
from tactibench_sim.mechanics.dome import TableMechanics
from tactibench_sim.mechanics.finite_elements import turn
from tactibench_sim.mechanics.tables import Tables

Array = npt.NDArray[np.float64]

STEP = math.radians(5.0)
"""Distance of two nodes, chords: 5 deg at the middle."""
AROUND = Cells(start=-20 * STEP, along=36, across=16, step=STEP, fade=1, closed=False)
"""Patch of O: it reaches to 122 deg up the dome and to 81 deg elsewhere."""
PAIR = Cells(start=-14 * STEP, along=29, across=15, step=STEP, fade=3, closed=True)
"""Patch of C: it reaches to 75 deg."""
BETA_STEP_DEG, BETAS = 5.0, 13  # 0 to 60 deg
ANGLE_STEP_DEG, ANGLES = 2.5, 25  # 0 to 60 deg
DEPTH_STEP_MM, DEPTHS = 0.5, 14  # 0 to 6.5 mm
FARTHEST_PAIR_DEG = 60.0
"""Fields of contacts this far apart are added without a correction."""
TURN_MM = 8.0
"""Displacement, mm, that counts as much as a turn of 1 rad when modes are chosen."""
MOST_AROUND, EVEN, ODD = 12, 8, 4
"""Numbers of modes; those of a pair are even or odd under the exchange of its contacts."""


@dataclass(frozen=True, eq=False)
class Single:
    """A run of one contact off the apex.

    Attributes:
        radius: Radius of the indenter, mm; inf: a plate.
        beta: Polar angle of the contact, rad.
        depths: (S,) penetrations, mm.
        chart: Places where the run was sampled.
        displacement: (S, 2, A, B, 3) displacement of inner and outer skin along e, f, m at the
            nodes of the chart, mm; NaN below the dome's rim.
    """

    radius: float
    beta: float
    depths: Array
    chart: Chart
    displacement: Array


@dataclass(frozen=True, eq=False)
class Pair:
    """A run of two contacts on both sides of the apex.

    Attributes:
        radius: Radius of the indenters, mm.
        angle: Angle between the contacts, rad; each is half of it from the apex.
        depths: (S, 2) penetrations, mm.
        chart: Places where the run was sampled.
        displacement: (S, 2, A, B, 3) as of Single.
    """

    radius: float
    angle: float
    depths: Array
    chart: Chart
    displacement: Array


def corrections_from(
    singles: Sequence[Single], pairs: Sequence[Pair], tables: Tables
) -> Corrections:
    """Return O, learned from singles, and C, learned from pairs, for single-contact tables."""
    arrays, grid = surroundings(singles, tables)
    with_surroundings = replace(tables, corrections=Corrections(arrays, grid))
    if not pairs:
        return with_surroundings.corrections
    more, also = together(pairs, with_surroundings)
    return Corrections({**arrays, **more}, {**grid, **also})


def surroundings(
    singles: Sequence[Single], tables: Tables
) -> tuple[dict[str, Array], dict[str, Any]]:
    """Return the arrays and the grid of O, see ``Corrections``."""
    radii = sorted({single.radius for single in singles})
    inner = inner_radius(tables)
    families = []
    for radius in radii:
        runs = sorted((s for s in singles if s.radius == radius), key=lambda s: s.beta)
        each = [evenly(run.depths, fields_of(run, inner), DEPTHS, DEPTH_STEP_MM) for run in runs]
        families.append(np.stack([values - each[0] for values in each]))
    betas = np.array(sorted({single.beta for single in singles}))
    coarse = on_cells(np.stack(families), singles[0].chart, AROUND)  # (M, B, S, A, B, 12)
    amounts, modes = reduced(coarse, MOST_AROUND)
    amounts = resampled(betas, amounts, 1, BETAS, math.radians(BETA_STEP_DEG))
    arrays = {
        **split_modes("around", modes),
        "around_amounts": coefficients(amounts, (1, 2)),
    }
    grid = {
        "around_radii": [None if math.isinf(radius) else radius for radius in radii],
        "around_step": AROUND.step,
        "around_start": AROUND.start,
        "beta_step": math.radians(BETA_STEP_DEG),
        "depth_step": DEPTH_STEP_MM,
    }
    return arrays, grid


def together(pairs: Sequence[Pair], tables: Tables) -> tuple[dict[str, Array], dict[str, Any]]:
    """Return the arrays and the grid of C, see ``Corrections``; the tables hold O."""
    mechanics = TableMechanics(tables, "coupled")
    angles = [0.0, *sorted(pair.angle for pair in pairs), math.radians(FARTHEST_PAIR_DEG)]
    ordered = sorted(pairs, key=lambda pair: pair.angle)
    nodes = np.unique(np.concatenate([[0.0], ordered[0].depths.ravel()]))
    rest = [on_cells(missing(pair, mechanics), pair.chart, PAIR) for pair in ordered]
    count = [len(pair.depths) for pair in ordered]
    fields = np.concatenate(rest)
    mirrored = mirror(fields)
    table = np.zeros((len(angles), len(nodes), len(nodes), 0))
    modes = np.zeros((0, *fields.shape[1:]))
    for sign, most in ((1.0, EVEN), (-1.0, ODD)):
        amounts, some = reduced((fields + sign * mirrored) / 2, most)
        some = (some + sign * mirror(some)) / 2
        part = np.zeros((*table.shape[:3], amounts.shape[-1]))
        for k, (pair, each) in enumerate(
            zip(ordered, np.split(amounts, np.cumsum(count)[:-1]), strict=True)
        ):
            first, second = (np.searchsorted(nodes, pair.depths[:, side]) for side in (0, 1))
            part[k + 1, second, first] = sign * each
            part[k + 1, first, second] = each
        if sign < 0:
            part[:, range(len(nodes)), range(len(nodes))] = 0.0
        table, modes = np.concatenate([table, part], axis=-1), np.concatenate([modes, some])
    for axis in (1, 2):
        table = resampled(nodes, table, axis, DEPTHS, DEPTH_STEP_MM)
    table = resampled(np.array(angles), table, 0, ANGLES, math.radians(ANGLE_STEP_DEG))
    arrays = {**split_modes("pair", modes), "pair_amounts": coefficients(table, (0, 1, 2))}
    grid = {
        "pair_radius": pairs[0].radius,
        "pair_even": EVEN,
        "pair_step": PAIR.step,
        "pair_start": PAIR.start,
        "angle_step": math.radians(ANGLE_STEP_DEG),
    }
    return arrays, grid


def mirror(values: Array) -> Array:
    """Return fields (..., A, B, 12) mirrored by e -> -e, which exchanges the two contacts."""
    flipped: Array = np.flip(values, axis=-3) * np.array([-1.0, 1.0, 1.0] * 4)
    return flipped


def inner_radius(tables: Tables) -> float:
    """Return the radius of the inner skin, mm."""
    dome = tables.parameters["dome"]
    return float(dome["outer"] - dome["skin"])


def fields_of(run: Single | Pair, inner: float) -> Array:
    """Return the (S, A, B, 12) quantities of a run: displacement, mm, and turn, rad, of each skin.

    The inner skin comes first. The turn of the outer skin is 0.

    Args:
        run: Run of one contact or of two.
        inner: Radius of the inner skin, mm.
    """
    displacement = np.nan_to_num(run.displacement)  # clamped below the rim
    below = displacement[:, 1]
    return np.concatenate(
        [six(run.chart, inner, displacement[:, 0]), below, np.zeros_like(below)], axis=-1
    )


def missing(pair: Pair, mechanics: TableMechanics) -> Array:
    """Return the (S, A, B, 12) part of a pair's field that shared loads and O do not explain."""
    chart, inner = pair.chart, mechanics.inner
    directions = chart.directions()
    flat = directions.reshape(-1, 3)
    fields = fields_of(pair, inner)
    half = pair.angle / 2
    n = np.array([[-math.sin(half), 0, math.cos(half)], [math.sin(half), 0, math.cos(half)]])
    reach = DOME_RADIUS_MM + pair.radius
    centres = (reach - pair.depths)[..., None] * n
    height = np.sqrt(reach**2 - (centres[..., :2] ** 2).sum(axis=-1))
    tips = Tips(centres[..., :2], height - centres[..., 2], np.full(len(centres), pair.radius))
    loads = mechanics.loads(tips)
    shape = (*fields.shape[:3], 3)
    u, q = (field.reshape(shape) for field in mechanics.displacement(loads, flat))
    outer = mechanics.outer_displacement(loads, flat)
    explained = np.concatenate([u, q, outer.reshape(u.shape), np.zeros_like(u)], axis=-1)
    # The chart's normals are those of a coarse grid: take the same grid's error out of both.
    exact = _turn_of(mechanics, loads, directions)
    explained[..., 3:6] = six(chart, inner, u)[..., 3:6] + (q - exact)
    difference: Array = fields - explained
    return difference


def _turn_of(mechanics: TableMechanics, loads: Any, directions: Array, step: float = 1e-4) -> Array:
    """Return the (S, A, B, 3) turn of normals of the displaced inner surface, by differences."""
    flat = directions.reshape(-1, 3)
    aside = np.where(abs(flat[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(flat, aside)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    tangents = []
    for tangent in (first, np.cross(flat, first)):
        ends = []
        for sign in (1.0, -1.0):
            moved = flat + sign * step * tangent
            moved /= np.linalg.norm(moved, axis=1, keepdims=True)
            ends.append(mechanics.inner * moved + mechanics.displacement(loads, moved)[0])
        tangents.append(ends[0] - ends[1])
    normal = np.cross(tangents[0], tangents[1])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return turn(flat, normal).reshape(len(normal), *directions.shape)


def evenly(nodes: Array, values: Array, count: int, step: float) -> Array:
    """Return values (S, ...) at S nodes as values at ``count`` nodes 0, step, 2 step, ...

    They are zero at 0, and extended linearly beyond the last node.
    """
    nodes, padded = np.append(0.0, nodes), np.concatenate([np.zeros_like(values[:1]), values])
    end = step * (count - 1)
    if nodes[-1] < end - 1e-9:
        ahead = (end - nodes[-1]) / (nodes[-1] - nodes[-2])
        padded = np.concatenate([padded, padded[-1:] + ahead * (padded[-1:] - padded[-2:-1])])
        nodes = np.append(nodes, end)
    return resampled(nodes, padded, 0, count, step)


def reduced(values: Array, most: int) -> tuple[Array, Array]:
    """Return amounts (..., R) and modes (R, A, B, 12) of values (..., A, B, 12).

    R is at most ``most``, see ``modes_of``.
    """
    weight = np.repeat([1.0, TURN_MM, 1.0, 1.0], 3)
    flat = (values * weight).reshape(-1, *values.shape[-3:])
    amounts, modes = modes_of(flat, most)
    return amounts.reshape(*values.shape[:-3], -1), modes / weight


def split_modes(kind: str, modes: Array) -> Mapping[str, Array]:
    """Return the arrays of a file for modes (R, A, B, 12), of pin bases and outer skin.

    Args:
        kind: "around" or "pair".
        modes: Modes of both skins.
    """
    filtered = coefficients(modes, (1, 2))
    return {f"{kind}_base_modes": filtered[..., :6], f"{kind}_skin_modes": filtered[..., 6:]}
