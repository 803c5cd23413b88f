"""Experiment 1: predicted against true on each axis, and the errors themselves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactibench.board.figures.style import (
    BLUE,
    GREEN,
    GREY,
    VERMILION,
    figure,
    headline,
    plain,
    save,
)

AXES = (("x", BLUE), ("y", VERMILION), ("z (depth)", GREEN))


def single_errors(
    path: Path,
    truth: npt.ArrayLike,
    predicted: npt.ArrayLike,
    *,
    title: str = "",
    measured_on: str = "",
) -> None:
    """Draw (N, 3) true and predicted x, y, depth, mm: scatter above, histogram of errors below.

    The histograms share one range, the 99.5th percentile of all absolute errors rounded up, so that
    axes can be compared by eye; errors outside are counted in the panel.
    """
    true, found = (np.asarray(v, dtype=np.float64).reshape(-1, 3) for v in (truth, predicted))
    error = found - true
    edge = histogram_edge(error)
    made = figure(9.0, 5.8)
    panels = made.subplots(2, 3, height_ratios=[3, 2])
    for k, (name, colour) in enumerate(AXES):
        scatter, histogram = panels[0, k], panels[1, k]
        ends = _ends(true[:, k], found[:, k])
        scatter.plot(ends, ends, color=GREY, linewidth=1, zorder=1)
        scatter.plot(true[:, k], found[:, k], ".", color=colour, markersize=3, alpha=0.6)
        scatter.set(
            xlim=ends,
            ylim=ends,
            aspect="equal",
            xlabel=f"true {name}, mm",
            ylabel=f"predicted {name}, mm",
        )
        scatter.set_xticks(scatter.get_yticks())
        scatter.set(xlim=ends, ylim=ends)
        histogram.hist(error[:, k], bins=np.linspace(-edge, edge, 41).tolist(), color=colour)
        histogram.axvline(0, color=GREY, linewidth=1)
        histogram.set(xlim=(-edge, edge), xlabel=f"error of {name}, mm")
        outside = int((np.abs(error[:, k]) > edge).sum())
        mae = np.abs(error[:, k]).mean() if len(error) else float("nan")
        note = f"MAE {mae:.4f} mm" + (f"\n{outside} outside" if outside else "")
        histogram.set_title(note if len(error) else "no answers", fontsize=9)
        for axes in (scatter, histogram):
            plain(axes)
    panels[1, 0].set_ylabel("presses")
    headline(made, title, "; ".join(filter(None, (measured_on, f"{len(true):,} presses"))))
    save(made, path)


def histogram_edge(error: npt.NDArray[np.float64]) -> float:
    """99.5th percentile of |error|, mm, rounded up to one significant digit."""
    if not error.size or not np.abs(error).max() > 0:
        return 0.1
    edge = float(np.quantile(np.abs(error), 0.995)) or float(np.abs(error).max())
    unit = 10.0 ** np.floor(np.log10(edge))
    return float(np.ceil(edge / unit * (1 - 1e-9)) * unit)


def _ends(*values: npt.NDArray[np.float64]) -> tuple[float, float]:
    every = np.concatenate(values)
    if not len(every):
        return 0.0, 1.0
    margin = 0.04 * max(float(np.ptp(every)), 1e-3)
    return float(every.min()) - margin, float(every.max()) + margin
