"""Arrows of real and simulated displacements side by side."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tactibench_sim.real.errors import Held
from tactibench_sim.real.presses import Presses
from tactibench_sim.real.simulate import indentation
from tactibench_sim.real.unknowns import Unknowns

REAL, SIMULATED = "#000000", "#D55E00"
_MARGIN_PX = 22.0


def chosen(presses: Presses, result: Held) -> list[int]:
    """Two presses each at tilts about -15, 0 and 15 deg: shallow and deep, of median error.

    Nobody picks: in each group the press stands for it whose relative error is its median.
    """
    labels = presses.labels
    rows: list[int] = []
    for deep in (False, True):
        for low, high in ((-21.0, -10.0), (-5.0, 5.0), (10.0, 21.0)):
            half = labels.depth > np.median(labels.depth)
            group = np.flatnonzero((labels.tilt > low) & (labels.tilt < high) & (half == deep))
            if len(group):
                order = group[np.argsort(result.relative[group], kind="stable")]
                rows.append(int(order[len(order) // 2]))
    return rows


def draw(path: Path, presses: Presses, result: Held, x: Unknowns, title: str) -> None:
    """Write a PNG of six presses: real arrows in black, simulated ones on them in orange."""
    figure = Figure(figsize=(13, 9.2), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    depth = indentation(x, presses.labels)
    rows = chosen(presses, result)
    axes = figure.subplots(2, 3, squeeze=False).ravel()
    for axis in axes[len(rows) :]:
        axis.set_visible(False)
    for axis, row in zip(axes, rows, strict=False):
        _arrows(axis, presses.rest, result.real[row], REAL, 0.0055)
        _arrows(axis, presses.rest, result.sim[row], SIMULATED, 0.0028)
        axis.set_title(
            f"{presses.names[row]}: {depth[row]:.1f} mm, tilt {presses.labels.tilt[row]:.0f} deg, "
            f"error {result.relative[row]:.0%}",
            fontsize=10,
        )
        axis.set_aspect("equal")
        (left, top), (right, bottom) = presses.rest.min(axis=0), presses.rest.max(axis=0)
        axis.set_xlim(left - _MARGIN_PX, right + _MARGIN_PX)
        axis.set_ylim(bottom + _MARGIN_PX, top - _MARGIN_PX)
        axis.tick_params(labelsize=8)
    figure.suptitle(title, fontsize=12)
    figure.savefig(path)


def _arrows(
    axis: Axes,
    rest: npt.NDArray[np.float64],
    moved: npt.NDArray[np.float64],
    colour: str,
    width: float,
) -> None:
    axis.quiver(
        *rest.T,
        *moved.T,
        angles="xy",
        scale_units="xy",
        scale=1,
        color=colour,
        width=width,
        headwidth=2.6,
        headlength=3.5,
        headaxislength=3.2,
        minlength=0.1,
    )
