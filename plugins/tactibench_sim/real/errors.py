"""How far simulated and real displacements are apart, over presses and over pins."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench_sim.real.presses import Presses
from tactibench_sim.real.simulate import Rig, directions, displacements, indentation
from tactibench_sim.real.unknowns import Unknowns

Array = npt.NDArray[np.float64]

DEPTHS = (0.0, 2.0, 3.0, 4.0, 5.0, 8.0)
TILTS = (0.0, 5.0, 10.0, 15.0, 21.0)
POLARS = (0.0, 15.0, 30.0, 45.0, 90.0)


@dataclass(frozen=True)
class Row:
    """One line of the table. relative: median over presses of ||sim - real|| / ||real||; pixels:
    mean distance of simulated and real pins, px; moved: mean real displacement, px."""

    group: str
    presses: int
    relative: float
    pixels: float
    moved: float


@dataclass(frozen=True, eq=False)
class Held:
    """Held-out presses under one assumption. sim, real: (S, P, 2) px; relative: (S,)."""

    sim: Array
    real: Array
    relative: Array


def held(presses: Presses, rig: Rig, x: Unknowns, *, state_known: bool = False) -> Held:
    """Simulate presses from their labels alone, all of them dragged as the labels say.

    ``state_known``: the frame decides for each press whether it was dragged at all.
    """
    moved = [
        _held(presses, displacements(rig, x, presses.labels, np.full(len(presses), dragged)))
        for dragged in ((1.0, 0.0) if state_known else (1.0,))
    ]
    if not state_known:
        return moved[0]
    yes, no = moved
    better = no.relative < yes.relative
    sim = np.where(better[:, None, None], no.sim, yes.sim)
    return Held(sim, yes.real, np.minimum(yes.relative, no.relative))


def _held(presses: Presses, sim: Array) -> Held:
    off = np.nansum((sim - presses.moved) ** 2, axis=(1, 2))
    return Held(sim, presses.moved, np.sqrt(off / np.nansum(presses.moved**2, axis=(1, 2))))


def table(presses: Presses, rig: Rig, x: Unknowns, result: Held) -> list[Row]:
    """All presses, then by indentation, tilt and polar angle of the pin."""
    depth, tilt = indentation(x, presses.labels), abs(presses.labels.tilt)
    polar = np.degrees(np.arccos(directions(rig, x)[:, 2]))
    every = np.ones(len(polar), dtype=np.bool_)
    whole = np.ones(len(presses), dtype=np.bool_)
    rows = [_row("all", result, whole, every)]
    groups = ("indentation", "mm", depth, DEPTHS), ("tilt", "deg", tilt, TILTS)
    for name, unit, values, edges in groups:
        for low, high in pairwise(edges):
            inside = (values >= low) & (values < high)
            if inside.any():
                rows.append(_row(f"{name} {low:g}-{high:g} {unit}", result, inside, every))
    for low, high in pairwise(POLARS):
        pins = (polar >= low) & (polar < high)
        if pins.any():
            rows.append(_row(f"pins {low:g}-{high:g} deg", result, whole, pins))
    return rows


def _row(
    group: str, result: Held, presses: npt.NDArray[np.bool_], pins: npt.NDArray[np.bool_]
) -> Row:
    sim, real = result.sim[presses][:, pins], result.real[presses][:, pins]
    off = np.nansum((sim - real) ** 2, axis=(1, 2)) / np.nansum(real**2, axis=(1, 2))
    apart = np.linalg.norm(sim - real, axis=-1)
    return Row(
        group,
        int(presses.sum()),
        float(np.median(np.sqrt(off))),
        float(np.nanmean(apart)),
        float(np.nanmean(np.linalg.norm(real, axis=-1))),
    )


def as_json(rows: list[Row]) -> list[dict[str, Any]]:
    """The table as plain data."""
    return [dict(vars(row)) for row in rows]
