"""Experiment 1: predicted against true values on each axis, and the errors themselves."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from tactibench.report.plots.style import BLUE, GREEN, GREY, VERMILION, headline, new_figure, plain

AXES = (("x", BLUE), ("y", VERMILION), ("z (depth)", GREEN))


def single_figure(
    truth: npt.ArrayLike, predicted: npt.ArrayLike, *, title: str = "", measured_on: str = ""
) -> Figure:
    """Draw true and predicted x, y, depth: scatter plots above, histograms of errors below.

    The histograms share one range, the 99.5th percentile of all absolute errors rounded up, so
    that axes can be compared by eye; errors outside are counted in the panel.

    Args:
        truth: (N, 3) true x, y, depth, mm.
        predicted: (N, 3) predicted x, y, depth, mm.
        title: Title of the picture.
        measured_on: Printed as subtitle.
    """
    true, estimate = (np.asarray(v, dtype=np.float64).reshape(-1, 3) for v in (truth, predicted))
    error = estimate - true
    edge = histogram_edge(error)
    figure = new_figure(9.0, 5.8)
    panels = figure.subplots(2, 3, height_ratios=[3, 2])
    for k, (name, colour) in enumerate(AXES):
        scatter, histogram = panels[0, k], panels[1, k]
        ends = _ends(true[:, k], estimate[:, k])
        scatter.plot(ends, ends, color=GREY, linewidth=1, zorder=1)
        scatter.plot(true[:, k], estimate[:, k], ".", color=colour, markersize=3, alpha=0.6)
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
        histogram.set_title(note if len(error) else "no predictions", fontsize=9)
        for axes in (scatter, histogram):
            plain(axes)
    panels[1, 0].set_ylabel("presses")
    headline(figure, title, measured_on, f"{len(true):,} presses")
    return figure


def histogram_edge(error: npt.NDArray[np.float64]) -> float:
    """Return the 99.5th percentile of |error|, mm, rounded up to one significant digit."""
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
