"""Make the file of tips of other radii from finite-element runs.

    PYTHONPATH=.:plugins python scripts/fem/tabulate_tips.py OUT RUNS [--pairs R ...]

RUNS is a folder that keeps every run, so that an interrupted tabulation goes on where it stopped.
The runs are axisymmetric single contacts (half a minute a radius), and in three dimensions single
contacts off the apex (a minute and a half a radius) and pairs of equal tips (a quarter of an hour a
radius). The pairs of a radius that --pairs does not name are interpolated between those of its
neighbours. R = 3 mm is taken from the tables that ship.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from fem_script import number, output_file, report_progress, write_file
from learn import (
    ANGLE_STEP_DEG,
    ANGLES,
    AROUND,
    BETA_STEP_DEG,
    BETAS,
    FARTHEST_PAIR_DEG,
    PAIR,
    TURN_MM,
    Pair,
    Single,
    evenly,
    fields_of,
    mirror,
    missing,
    reduced,
    split_modes,
)
from modes import coefficients, on_cells, resampled
from snapshots import NOMINAL_MM, make, tip_plan
from tabulate_dome import columns

from tactibench.lab import atomic
from tactibench_sim import data_file, fem
from tactibench_sim.mechanics import tables
from tactibench_sim.mechanics.dome import TableMechanics
from tactibench_sim.mechanics.tables import QUANTITIES
from tactibench_sim.mechanics.tip_tables import DEEPEST_MM, QUANTUM, SHARES, TipTables, deepest

Array = npt.NDArray[np.float64]
RADII = (1.0, 1.5, 2.0, 2.5, 4.0, 5.0, 6.0, 8.0)
ALL = tuple(sorted((*RADII, NOMINAL_MM)))
STEP_MM, POLAR_STEP_DEG = 0.125, 0.5
REACH_RADII = 2.0
"""Depth of the axisymmetric runs in radii: deeper than any tip may be pressed, so that a radius
between two others has neighbours at its own depth."""
SHARP_MM, SHARP_APEX_MM = 2.0, 0.05
"""Tips of a radius below the first get elements of the size of the second at the apex."""
MOST_AROUND, EVEN, ODD = 12, 12, 4
SAMPLED_BETAS, SAMPLED_ANGLES = (0, 4, 8, 11), (4, 6, 7, 10, 12, 16)
"""Nodes of the nominal tip's tables near those of the runs, from which modes are chosen."""


def tabulate(
    path: Path,
    runs: Path,
    pair_radii: Sequence[float] = RADII,
    progress: Callable[[str], None] = lambda _: None,
) -> str:
    """Make the runs that are missing in a folder, write the file and return its digest.

    Nothing is written unless every run converged.

    Args:
        path: File to write.
        runs: Folder of the runs; it is made where it does not exist.
        pair_radii: Radii of the tips whose pairs are pressed, mm.
        progress: Function that is told the name of each run before it starts.

    Raises:
        UserError: NGSolve is not installed, or a run in the folder cannot be read or is of another
            dome or mesh.
        fem.NotConvergedError: A run failed.
    """
    runs.mkdir(parents=True, exist_ok=True)
    dome = fem.Dome()
    delta = np.arange(round(DEEPEST_MM / STEP_MM) + 1, dtype=np.float64) * STEP_MM
    polar = np.radians(np.arange(round(90 / POLAR_STEP_DEG) + 1) * POLAR_STEP_DEG)
    each = []
    for radius in ALL:
        progress(f"sphere{radius:g}")
        each.append(single_fields(runs, dome, radius, delta, polar))
    fields = {name: np.stack([quantities[name] for quantities in each]) for name in QUANTITIES}
    singles, pairs = make(runs, dome, tip_plan(RADII, pair_radii), progress)
    arrays, grid = surroundings(singles, dome.inner)
    parameters = {"dome": asdict(dome), "corrections": grid}
    plain = TipTables(parameters, "", np.array(ALL), np.array(ALL), delta, polar, fields, arrays)
    more, with_pairs = together(pairs, plain)
    return data_file.write(
        path,
        {
            **{name: _whole(name, values) for name, values in fields.items()},
            **{name: values.astype(np.float16) for name, values in {**arrays, **more}.items()},
            "radii": np.array(ALL),
            "pair_radii": with_pairs,
            "delta": delta,
            "polar": polar,
        },
        parameters,
    )


def _whole(name: str, values: Array) -> npt.NDArray[Any]:
    """Return lengths and angles as whole multiples of QUANTUM, and forces as float32."""
    if name == "force":
        return values.astype(np.float32)
    multiples = np.round(values / QUANTUM)
    if abs(multiples).max() > np.iinfo(np.int16).max:
        raise ValueError(f"{name} reaches {abs(values).max():.2f}, more than two bytes hold")
    return multiples.astype(np.int16)


def single_fields(
    runs: Path, dome: fem.Dome, radius: float, delta: Array, polar: Array
) -> dict[str, Array]:
    """Return the quantities (D, T), or force (D,), of a tip on the apex.

    Beyond the deepest run they are extended linearly. Those of the nominal tip come from the tables
    that ship, those of other tips from a file in the folder, which is made where it is missing.

    Args:
        runs: Folder of the runs.
        dome: Dome that is pressed.
        radius: Radius of the tip, mm.
        delta: (D,) penetrations, mm.
        polar: (T,) polar angles, rad.
    """
    if radius == NOMINAL_MM:
        table = tables.shipped().by_radius[NOMINAL_MM]
        return {name: table.fields[name][: len(delta)] for name in QUANTITIES}
    path = runs / f"axi_{radius:g}.npz"
    if not path.exists():
        fine = replace(dome, apex_size=SHARP_APEX_MM) if radius < SHARP_MM else dome
        pressed = columns(fine, radius, delta[delta <= REACH_RADII * radius + 1e-9], polar)
        with atomic(path) as out:
            np.savez(out, allow_pickle=False, **pressed)
    with np.load(path) as run:
        return {name: _continued(run[name], len(delta)) for name in QUANTITIES}


def _continued(values: Array, count: int) -> Array:
    """Return values (D, ...) extended to ``count`` depths, linearly beyond the last one."""
    more = np.arange(1, count - len(values) + 1).reshape(-1, *[1] * (values.ndim - 1))
    return np.concatenate([values, values[-1] + more * (values[-1] - values[-2])])


def surroundings(
    singles: Sequence[Single], inner: float
) -> tuple[dict[str, Array], dict[str, Any]]:
    """Return arrays and grid of O for all radii, by shares of the greatest penetration.

    Args:
        singles: Runs of single contacts.
        inner: Radius of the inner skin, mm.
    """
    nominal, step = _nominal("around"), _nominal_grid()["around_step"]
    betas = np.array(sorted({single.beta for single in singles}))
    coarse = []
    for radius in RADII:
        runs = sorted((s for s in singles if s.radius == radius), key=lambda s: s.beta)
        end = deepest(radius)
        each = [
            evenly(run.depths / end, fields_of(run, inner), SHARES + 1, 1 / SHARES) for run in runs
        ]
        coarse.append(
            on_cells(np.stack([values - each[0] for values in each]), runs[0].chart, AROUND)
        )
    sampled = nominal[list(SAMPLED_BETAS)][:, : SHARES + 1]
    amounts, modes = reduced(np.concatenate([np.stack(coarse), sampled[None]]), MOST_AROUND)
    tabled = resampled(betas, amounts[:-1], 1, BETAS, math.radians(BETA_STEP_DEG))
    all_amounts = np.insert(
        tabled, ALL.index(NOMINAL_MM), projected(nominal[:, : SHARES + 1], modes), 0
    )
    return (
        {**split_modes("around", modes), "around_amounts": coefficients(all_amounts, (1, 2))},
        {
            "around_step": step,
            "around_start": AROUND.start,
            "beta_step": math.radians(BETA_STEP_DEG),
            "pair_even": EVEN,
            "pair_step": PAIR.step,
            "pair_start": PAIR.start,
            "angle_step": math.radians(ANGLE_STEP_DEG),
        },
    )


def together(pairs: Sequence[Pair], plain: TipTables) -> tuple[dict[str, Array], Array]:
    """Return the arrays of C, by shares of the greatest penetration, and their radii, mm.

    Args:
        pairs: Runs of pairs.
        plain: Tables of single contacts, with O.
    """
    radii = sorted({pair.radius for pair in pairs})
    fields = []
    for radius in radii:
        alone = plain.tables(radius, pairs=False)
        mechanics = TableMechanics(alone, "coupled")
        fields += [
            (pair, on_cells(missing(pair, mechanics), pair.chart, PAIR))
            for pair in sorted((p for p in pairs if p.radius == radius), key=lambda p: p.angle)
        ]
    nominal = _nominal("pair")[:, : SHARES + 1, : SHARES + 1]
    rows, columns = np.tril_indices(SHARES + 1)
    some = nominal[list(SAMPLED_ANGLES)][:, rows, columns]
    every = np.concatenate([*(f for _, f in fields), some.reshape(-1, *some.shape[2:])])
    modes = np.zeros((0, *every.shape[1:]))
    for sign, most in ((1.0, EVEN), (-1.0, ODD)):
        _, part = reduced((every + sign * mirror(every)) / 2, most)
        modes = np.concatenate([modes, (part + sign * mirror(part)) / 2])
    tabled = [
        _pair_amounts([(p, f) for p, f in fields if p.radius == radius], modes) for radius in radii
    ]
    place = int(np.searchsorted(radii, NOMINAL_MM))
    tabled.insert(place, projected(nominal, modes))
    arrays = {
        **split_modes("pair", modes),
        "pair_amounts": coefficients(np.stack(tabled), (1, 2, 3)),
    }
    return arrays, np.array([*radii[:place], NOMINAL_MM, *radii[place:]])


def _pair_amounts(found: Sequence[tuple[Pair, Array]], modes: Array) -> Array:
    """Return the (ANGLES, SHARES + 1, SHARES + 1, R) amounts of the pairs of one tip."""
    end = deepest(found[0][0].radius)
    nodes = np.unique(np.concatenate([[0.0], found[0][0].depths.ravel() / end]).round(6))
    angles = [0.0, *(pair.angle for pair, _ in found), math.radians(FARTHEST_PAIR_DEG)]
    table = np.zeros((len(angles), len(nodes), len(nodes), len(modes)))
    parity = np.where(np.arange(len(modes)) < EVEN, 1.0, -1.0)
    for k, (pair, fields) in enumerate(found, start=1):
        first, second = (np.searchsorted(nodes, (pair.depths[:, s] / end).round(6)) for s in (0, 1))
        amounts = projected(fields, modes)
        table[k, second, first] = parity * amounts
        table[k, first, second] = amounts
    table[:, range(len(nodes)), range(len(nodes)), EVEN:] = 0.0
    for axis in (1, 2):
        table = resampled(nodes, table, axis, SHARES + 1, 1 / SHARES)
    return resampled(np.array(angles), table, 0, ANGLES, math.radians(ANGLE_STEP_DEG))


def projected(values: Array, modes: Array) -> Array:
    """Return the amounts (..., R) of modes (R, A, B, 12) in values (..., A, B, 12)."""
    weight = np.repeat([1.0, TURN_MM, 1.0, 1.0], 3)
    basis = (modes * weight).reshape(len(modes), -1).T
    flat = (values * weight).reshape(-1, len(basis))
    amounts: Array = np.linalg.lstsq(basis, flat.T, rcond=None)[0].T
    return amounts.reshape(*values.shape[:-3], len(modes))


def _nominal_grid() -> dict[str, Any]:
    return dict(tables.shipped().corrections.grid)


def _nominal(kind: str) -> Array:
    """Return the nominal tip's corrections at their own nodes, (..., A, B, 12).

    Nodes of penetration are 0.5 mm apart, which is 1 / SHARES of the greatest one of R = 3 mm.
    """
    corrections = tables.shipped().corrections
    base, skin = (corrections.arrays[f"{kind}_{where}_modes"] for where in ("base", "skin"))
    modes = at_nodes(np.concatenate([base, skin], axis=-1), (1, 2))
    amounts = corrections.arrays[f"{kind}_amounts"]
    if kind == "around":
        amounts = amounts[corrections.grid["around_radii"].index(NOMINAL_MM)]
    amounts = at_nodes(amounts, range(amounts.ndim - 1))
    return np.tensordot(amounts, modes, 1)


def at_nodes(spline: Array, axes: Sequence[int]) -> Array:
    """Return the values at the nodes of cubic B-splines.

    Args:
        spline: Coefficients of the splines, one more than nodes at each end of every axis.
        axes: Axes along which the coefficients lie.
    """
    out = spline
    for axis in axes:
        c = np.moveaxis(out, axis, 0)
        out = np.moveaxis((c[:-2] + 4 * c[1:-1] + c[2:]) / 6, 0, axis)
    return out


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Make tables of tips of other radii.")
    parser.add_argument("out", type=output_file)
    parser.add_argument("runs", type=Path)
    parser.add_argument("--pairs", type=number(1, 8), nargs="*", default=RADII, metavar="R")
    given = parser.parse_args(arguments)
    write_file(given.out, lambda: tabulate(given.out, given.runs, given.pairs, report_progress))


if __name__ == "__main__":
    main()
