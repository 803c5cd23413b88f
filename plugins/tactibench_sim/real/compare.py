"""The comparison itself: fit on some presses, report on the others."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactibench.datasets.importing import open_recording
from tactibench_sim.real.calibration import Calibration
from tactibench_sim.real.errors import Held, Row, as_json, held, table
from tactibench_sim.real.fit import Fitted, fit_best, rig
from tactibench_sim.real.plates import kinds
from tactibench_sim.real.presses import Presses, read

LARGEST_MOVE_MM = 1.0
"""Presses that moved less along the plate: the rest are sheared by more than sticking explains."""
FEWEST_HELD_OUT = 50


@dataclass(frozen=True, eq=False)
class Comparison:
    """presses: the held-out ones. labels, state: results without and with the known state."""

    presses: Presses
    fitted_on: int
    complete: float
    fitted: Fitted
    labels: Held
    state: Held
    rows: list[Row]
    calibration: Calibration

    def record(self) -> dict[str, Any]:
        """Everything as plain data."""
        return {
            "presses": {"fitted": self.fitted_on, "held_out": len(self.presses)},
            "all_pins_matched": self.complete,
            "dome": self.fitted.kind,
            "unknowns": asdict(self.fitted.unknowns),
            "median_relative_error": float(np.median(self.labels.relative)),
            "mean_relative_error": float(np.mean(self.labels.relative)),
            "median_relative_error_state_known": float(np.median(self.state.relative)),
            "dragged_share": self.dragged_share,
            "table": as_json(self.rows),
        }

    def numbers(self) -> list[dict[str, Any]]:
        """Every number as rows of metric, group, value, unit."""

        def row(metric: str, group: str, value: float, unit: str) -> dict[str, Any]:
            return {"metric": metric, "group": group, "value": value, "unit": unit}

        known = float(np.median(self.state.relative))
        found = [
            row("presses fitted", "all", self.fitted_on, ""),
            row("frames with all pins matched", "all", self.complete, "share"),
            row("median relative error, drag state known", "all", known, ""),
            row("presses that dragged the skin", "all", self.dragged_share, "share"),
        ]
        found += [row("unknown", n, v, "") for n, v in asdict(self.fitted.unknowns).items()]
        for one in self.rows:
            found.append(row("presses", one.group, one.presses, ""))
            found.append(row("median relative error", one.group, one.relative, ""))
            found.append(row("mean pin error", one.group, one.pixels, "px"))
            found.append(row("mean pin displacement", one.group, one.moved, "px"))
        return found

    @property
    def dragged_share(self) -> float:
        """Share of the held-out presses that the dragged field fits better than the undragged."""
        return float((self.labels.relative <= self.state.relative).mean())


def compare(folder: Path, *, fit_on: int = 200, seed: int = 0) -> Comparison:
    """Fit on ``fit_on`` presses, drawn by ``seed``, report on the others. Raises UserError."""
    presses = read(folder, LARGEST_MOVE_MM, fit_on + FEWEST_HELD_OUT)
    order = np.random.default_rng(seed).permutation(len(presses))
    first, others = presses.take(order[:fit_on]), presses.take(order[fit_on:])
    fitted = fit_best(first, [kind for kind in kinds() if kind.endswith("_stick")])
    what = rig(presses, fitted.kind)
    labels = held(others, what, fitted.unknowns)
    return Comparison(
        others,
        fit_on,
        presses.complete,
        fitted,
        labels,
        held(others, what, fitted.unknowns, state_known=True),
        table(others, what, fitted.unknowns, labels),
        Calibration(
            recording=open_recording(folder).sha256,
            frames=tuple(sorted(first.names)),
            side=presses.side,
            rest_centre=(float(presses.rest[:, 0].mean()), float(presses.rest[:, 1].mean())),
            kind=fitted.kind,
            unknowns=fitted.unknowns,
        ),
    )
