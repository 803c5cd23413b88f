"""The comparison of simulated and real plate presses: fit on some, report on the others."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.datasets import open_recording
from tactibench_sim.real.calibration import Calibration, Unknowns
from tactibench_sim.real.fit import Fit, fit_best, rig_of
from tactibench_sim.real.plate import Rig, directions, displacements, indentation, kinds
from tactibench_sim.real.recording import Presses, read

Array = npt.NDArray[np.float64]
LARGEST_MOVE_MM = 1.0
"""Presses that moved less along the plate: the rest are sheared by more than sticking explains."""
FEWEST_HELD_OUT = 50
"""Presses below which a median error on held-out ones says little."""
DEPTHS = (0.0, 2.0, 3.0, 4.0, 5.0, 8.0)
TILTS = (0.0, 5.0, 10.0, 15.0, 21.0)
POLARS = (0.0, 15.0, 30.0, 45.0, 90.0)
"""Edges of the groups in the table: mm of indentation, deg of tilt, deg of a pin's polar angle."""


@dataclass(frozen=True)
class ErrorRow:
    """One line of the table.

    relative: median over presses of ||sim - real|| / ||real||. pixels: mean distance of simulated
    and real pins, px. moved: mean real displacement, px.
    """

    group: str
    presses: int
    relative: float
    pixels: float
    moved: float


@dataclass(frozen=True, eq=False)
class Errors:
    """Presses beside their simulation. sim, real: (S, P, 2) px; relative: (S,)."""

    sim: Array
    real: Array
    relative: Array


@dataclass(frozen=True, eq=False)
class Comparison:
    """The fit and its errors on presses that were held out.

    presses: the held-out ones. fitted_on: how many presses were fitted. complete: share of frames
    with all pins matched. from_labels, state_known: errors from the labels alone, and where the
    frame decides whether the plate dragged the skin.
    """

    presses: Presses
    fitted_on: int
    complete: float
    fit: Fit
    from_labels: Errors
    state_known: Errors
    rows: list[ErrorRow]
    calibration: Calibration

    @property
    def dragged_share(self) -> float:
        """Share of the held-out presses that the dragged field fits better than the undragged."""
        return float((self.from_labels.relative <= self.state_known.relative).mean())

    @property
    def median_error(self) -> float:
        """Median relative error from the labels alone."""
        return float(np.median(self.from_labels.relative))

    @property
    def median_error_state_known(self) -> float:
        """Median relative error where the frame decides whether the plate dragged the skin."""
        return float(np.median(self.state_known.relative))

    def numbers(self) -> list[dict[str, Any]]:
        """Return every number as rows of metric, group, value, unit."""

        def row(metric: str, group: str, value: float, unit: str) -> dict[str, Any]:
            return {"metric": metric, "group": group, "value": value, "unit": unit}

        numbers = [
            row("presses fitted", "all", self.fitted_on, ""),
            row("frames with all pins matched", "all", self.complete, "share"),
            row(
                "median relative error, drag state known", "all", self.median_error_state_known, ""
            ),
            row("presses that dragged the skin", "all", self.dragged_share, "share"),
        ]
        numbers += [row("unknown", n, v, "") for n, v in asdict(self.fit.unknowns).items()]
        for line in self.rows:
            numbers.append(row("presses", line.group, line.presses, ""))
            numbers.append(row("median relative error", line.group, line.relative, ""))
            numbers.append(row("mean pin error", line.group, line.pixels, "px"))
            numbers.append(row("mean pin displacement", line.group, line.moved, "px"))
        return numbers


def compare(folder: Path, *, fit_on: int = 200, seed: int = 0) -> Comparison:
    """Fit on ``fit_on`` presses, drawn by ``seed``, report on the others. Raises UserError."""
    presses = read(folder, LARGEST_MOVE_MM, fit_on + FEWEST_HELD_OUT)
    order = np.random.default_rng(seed).permutation(len(presses))
    first, others = presses.take(order[:fit_on]), presses.take(order[fit_on:])
    fit = fit_best(first, [kind for kind in kinds() if kind.endswith("_stick")])
    rig = rig_of(presses, fit.kind)
    from_labels = errors_of(others, rig, fit.unknowns)
    return Comparison(
        others,
        fit_on,
        presses.complete,
        fit,
        from_labels,
        errors_of(others, rig, fit.unknowns, state_known=True),
        error_table(others, rig, fit.unknowns, from_labels),
        Calibration(
            recording=open_recording(folder).sha256,
            frames=tuple(sorted(first.names)),
            side=presses.side,
            rest_centre=(float(presses.rest[:, 0].mean()), float(presses.rest[:, 1].mean())),
            kind=fit.kind,
            unknowns=fit.unknowns,
        ),
    )


def errors_of(presses: Presses, rig: Rig, x: Unknowns, *, state_known: bool = False) -> Errors:
    """Simulate presses from their labels alone, all of them dragged as the labels say.

    ``state_known``: the frame decides for each press whether it was dragged at all.
    """
    dragged = _errors(presses, rig, x, 1.0)
    if not state_known:
        return dragged
    undragged = _errors(presses, rig, x, 0.0)
    better = undragged.relative < dragged.relative
    sim = np.where(better[:, None, None], undragged.sim, dragged.sim)
    return Errors(sim, dragged.real, np.minimum(dragged.relative, undragged.relative))


def _errors(presses: Presses, rig: Rig, x: Unknowns, dragged: float) -> Errors:
    sim = displacements(rig, x, presses.labels, np.full(len(presses), dragged))
    off = np.nansum((sim - presses.moved) ** 2, axis=(1, 2))
    return Errors(sim, presses.moved, np.sqrt(off / np.nansum(presses.moved**2, axis=(1, 2))))


def error_table(presses: Presses, rig: Rig, x: Unknowns, errors: Errors) -> list[ErrorRow]:
    """Return rows for all presses, then by indentation, tilt and polar angle of the pin."""
    depth, tilt = indentation(x, presses.labels), abs(presses.labels.tilt)
    polar = np.degrees(np.arccos(directions(rig, x)[:, 2]))
    all_pins = np.ones(len(polar), dtype=np.bool_)
    all_presses = np.ones(len(presses), dtype=np.bool_)
    rows = [_row("all", errors, all_presses, all_pins)]
    groups = ("indentation", "mm", depth, DEPTHS), ("tilt", "deg", tilt, TILTS)
    for name, unit, values, edges in groups:
        for low, high in pairwise(edges):
            inside = (values >= low) & (values < high)
            if inside.any():
                rows.append(_row(f"{name} {low:g}-{high:g} {unit}", errors, inside, all_pins))
    for low, high in pairwise(POLARS):
        pins = (polar >= low) & (polar < high)
        if pins.any():
            rows.append(_row(f"pins {low:g}-{high:g} deg", errors, all_presses, pins))
    return rows


def _row(
    group: str, errors: Errors, presses: npt.NDArray[np.bool_], pins: npt.NDArray[np.bool_]
) -> ErrorRow:
    sim, real = errors.sim[presses][:, pins], errors.real[presses][:, pins]
    off = np.nansum((sim - real) ** 2, axis=(1, 2)) / np.nansum(real**2, axis=(1, 2))
    apart = np.linalg.norm(sim - real, axis=-1)
    return ErrorRow(
        group,
        int(presses.sum()),
        float(np.median(np.sqrt(off))),
        float(np.nanmean(apart)),
        float(np.nanmean(np.linalg.norm(real, axis=-1))),
    )
