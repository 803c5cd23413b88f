"""From finite-element runs to the corrections of a table file.

O, the surroundings of one contact: the run at a polar angle minus the run at the apex (both on the
same kind of mesh, so its error cancels). C, the pair: the run with two contacts minus what shared
loads and O say. Both are reduced to a few modes whose amounts are splines of the contact.
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
"""Between nodes, chords: 5 deg at the middle."""
AROUND = Cells(start=-20 * STEP, along=36, across=16, step=STEP, fade=1, closed=False)
"""To 122 deg up the dome and 81 deg elsewhere."""
PAIR = Cells(start=-14 * STEP, along=29, across=15, step=STEP, fade=3, closed=True)
"""To 75 deg."""
BETA_STEP_DEG, BETAS = 5.0, 13  # 0 to 60 deg
ANGLE_STEP_DEG, ANGLES = 2.5, 25  # 0 to 60 deg
DEPTH_STEP_MM, DEPTHS = 0.5, 14  # 0 to 6.5 mm
FARTHEST_PAIR_DEG = 60.0
"""Contacts this far apart add up without a correction."""
TURN_MM = 8.0
"""mm that a turn of 1 rad counts for when modes are chosen."""
MOST_AROUND, EVEN, ODD = 12, 8, 4
"""Modes; those of a pair are even or odd under the exchange of its contacts."""


@dataclass(frozen=True, eq=False)
class Single:
    """One contact at the polar angle beta (rad), pressed to depths (S,), mm.

    displacement: (S, 2, A, B, 3) of inner and outer skin along e, f, n at the nodes of chart, mm;
    NaN below the dome's rim. radius: mm, inf for a plate.
    """

    radius: float
    beta: float
    depths: Array
    chart: Chart
    displacement: Array


@dataclass(frozen=True, eq=False)
class Pair:
    """Two contacts at +-angle/2 (rad) from the apex, pressed to depths (S, 2), mm; as Single."""

    radius: float
    angle: float
    depths: Array
    chart: Chart
    displacement: Array


def corrections_from(
    singles: Sequence[Single], pairs: Sequence[Pair], tables: Tables
) -> Corrections:
    """O from singles and C from pairs, for the single-contact tables."""
    arrays, grid = surroundings(singles, tables)
    known = replace(tables, corrections=Corrections(arrays, grid))
    if not pairs:
        return known.corrections
    more, also = together(pairs, known)
    return Corrections({**arrays, **more}, {**grid, **also})


def surroundings(
    singles: Sequence[Single], tables: Tables
) -> tuple[dict[str, Array], dict[str, Any]]:
    """Arrays and grid of O."""
    radii = sorted({single.radius for single in singles})
    inner = inner_radius(tables)
    families = []
    for radius in radii:
        runs = sorted((s for s in singles if s.radius == radius), key=lambda s: s.beta)
        each = [_by_depth(run.depths, fields_of(run, inner)) for run in runs]
        families.append(np.stack([one - each[0] for one in each]))
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
    """Arrays and grid of C."""
    mechanics = TableMechanics(tables, "coupled")
    angles = [0.0, *sorted(pair.angle for pair in pairs), math.radians(FARTHEST_PAIR_DEG)]
    ordered = sorted(pairs, key=lambda pair: pair.angle)
    nodes = np.unique(np.concatenate([[0.0], ordered[0].depths.ravel()]))
    rest = [on_cells(missing(pair, mechanics), pair.chart, PAIR) for pair in ordered]
    count = [len(pair.depths) for pair in ordered]
    whole = np.concatenate(rest)
    mirrored = mirror(whole)
    table = np.zeros((len(angles), len(nodes), len(nodes), 0))
    modes = np.zeros((0, *whole.shape[1:]))
    for sign, most in ((1.0, EVEN), (-1.0, ODD)):
        amounts, some = reduced((whole + sign * mirrored) / 2, most)
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
    """Fields (..., A, B, 12) mirrored by e -> -e, which exchanges the two contacts."""
    flipped: Array = np.flip(values, axis=-3) * np.array([-1.0, 1.0, 1.0] * 4)
    return flipped


def inner_radius(tables: Tables) -> float:
    """Return the radius of the inner skin, mm."""
    dome = tables.parameters["dome"]
    return float(dome["outer"] - dome["skin"])


def fields_of(run: Single | Pair, inner: float) -> Array:
    """Return (S, A, B, 12): six quantities of the inner skin, then of the outer, without turn."""
    displacement = np.nan_to_num(run.displacement)  # clamped below the rim
    below = displacement[:, 1]
    return np.concatenate(
        [six(run.chart, inner, displacement[:, 0]), below, np.zeros_like(below)], axis=-1
    )


def missing(pair: Pair, mechanics: TableMechanics) -> Array:
    """Return (S, A, B, 12): the part of a pair that loads and surroundings leave out."""
    chart, inner = pair.chart, mechanics.inner
    directions = chart.directions()
    flat = directions.reshape(-1, 3)
    found = fields_of(pair, inner)
    half = pair.angle / 2
    n = np.array([[-math.sin(half), 0, math.cos(half)], [math.sin(half), 0, math.cos(half)]])
    reach = DOME_RADIUS_MM + pair.radius
    centres = (reach - pair.depths)[..., None] * n
    height = np.sqrt(reach**2 - (centres[..., :2] ** 2).sum(axis=-1))
    tips = Tips(centres[..., :2], height - centres[..., 2], np.full(len(centres), pair.radius))
    loads = mechanics.loads(tips)
    shape = (*found.shape[:3], 3)
    u, q = (field.reshape(shape) for field in mechanics.displacement(loads, flat))
    outer = mechanics.outer_displacement(loads, flat)
    told = np.concatenate([u, q, outer.reshape(u.shape), np.zeros_like(u)], axis=-1)
    # The chart's normals are those of a coarse grid: take the same grid's error out of both.
    exact = _turn_of(mechanics, loads, directions)
    told[..., 3:6] = six(chart, inner, u)[..., 3:6] + (q - exact)
    difference: Array = found - told
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


def _by_depth(depths: Array, values: Array) -> Array:
    """Values (S, ...) at depths as values at 0, 0.5, ... mm; zero at 0, linear beyond the last."""
    nodes, known = np.append(0.0, depths), np.concatenate([np.zeros_like(values[:1]), values])
    end = DEPTH_STEP_MM * (DEPTHS - 1)
    if nodes[-1] < end:
        ahead = (end - nodes[-1]) / (nodes[-1] - nodes[-2])
        known = np.concatenate([known, known[-1:] + ahead * (known[-1:] - known[-2:-1])])
        nodes = np.append(nodes, end)
    return resampled(nodes, known, 0, DEPTHS, DEPTH_STEP_MM)


def reduced(values: Array, most: int) -> tuple[Array, Array]:
    """Return amounts (..., R) and modes (R, A, B, 12) of values (..., A, B, 12)."""
    weight = np.repeat([1.0, TURN_MM, 1.0, 1.0], 3)
    flat = (values * weight).reshape(-1, *values.shape[-3:])
    amounts, modes = modes_of(flat, most)
    return amounts.reshape(*values.shape[:-3], -1), modes / weight


def split_modes(kind: str, modes: Array) -> Mapping[str, Array]:
    """Return the arrays of a file for modes (R, A, B, 12): pin bases and outer skin."""
    filtered = coefficients(modes, (1, 2))
    return {f"{kind}_base_modes": filtered[..., :6], f"{kind}_skin_modes": filtered[..., 6:]}
