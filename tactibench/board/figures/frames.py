"""One test frame: what the camera saw, what the model made of it, and what was there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy.typing as npt
from matplotlib.lines import Line2D

from tactibench.board.figures.marks import heat, marks, millimetres, outline, rings, tip_outline
from tactibench.board.figures.style import BLACK, ORANGE, figure, headline, save
from tactibench.contacts import Contacts, FloatArray, Grid

Camera = Callable[[FloatArray], FloatArray]
"""(N, 2) mm -> (N, 2) pixel x, y."""


def overlay(
    path: Path,
    image: npt.NDArray[Any],
    grid: Grid,
    heatmap: npt.NDArray[Any] | None,
    truth: Contacts,
    predicted: Contacts,
    max_depth: float,
    *,
    true_heatmap: npt.NDArray[Any] | None = None,
    camera: Camera | None = None,
    title: str = "",
    measured_on: str = "",
) -> None:
    """Draw a frame, the true heatmap if given, and the predicted one with truth and predictions.

    image: (H, W) or (H, W, 3) uint8. heatmap, true_heatmap: (rows, columns) of the grid in 0..1;
    without a heatmap the contacts stand on an empty field. Pixels and millimetres are different
    spaces, so contacts appear on the frame only when a ``camera`` maps them.
    """
    true_panel = true_heatmap is not None
    made = figure(9.6, 4.2) if true_panel else figure(8.0, 4.6)
    panels = list(made.subplots(1, 3 if true_panel else 2))
    frame, answer = panels[0], panels[-1]
    frame.imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
    frame.set(title="frame", xlabel="column, px", ylabel="row, px")
    if camera is not None:
        for middle in truth.xy:
            frame.plot(
                *camera(tip_outline(middle)).T, color="white", linewidth=1.5, path_effects=outline()
            )
        marks(frame, Contacts(camera(predicted.xy), predicted.depth, predicted.score), ORANGE)
        frame.set(xlim=(-0.5, image.shape[1] - 0.5), ylim=(image.shape[0] - 0.5, -0.5))
    fields = [(answer, heatmap, "prediction")]
    if true_panel:
        fields.insert(0, (panels[1], true_heatmap, "truth"))
    shown = None
    for axes, values, name in fields:
        if values is None:
            axes.set_facecolor("#F2F2F2")
        else:
            shown = heat(axes, grid, values, max_depth)
        contour = "white" if values is None else "black"
        rings(axes, truth, BLACK if values is None else "white", contour=contour)
        millimetres(axes, grid)
        axes.set_title(name if values is not None else f"{name} (no heatmap)")
    marks(answer, predicted, ORANGE)
    if shown is not None:
        made.colorbar(shown, ax=panels[1:], label="heatmap, mm", shrink=0.85)
    made.legend(
        handles=_legend(truth, predicted),
        loc="outside lower center",
        ncols=2,
        frameon=False,
        fontsize=9,
    )
    headline(made, title, measured_on)
    save(made, path)


def _legend(truth: Contacts, predicted: Contacts) -> list[Line2D]:
    ring = Line2D(
        [],
        [],
        linestyle="none",
        marker="o",
        markersize=11,
        markerfacecolor="none",
        color=BLACK,
        label=f"truth ({len(truth)}), ring: tip, number: depth in mm",
    )
    found = ", ".join(f"{depth:.1f}" for depth in predicted.depth)
    text = f"predicted ({len(predicted)})" + (f", depth {found} mm" if found else "")
    cross = Line2D(
        [],
        [],
        linestyle="none",
        marker="x",
        markersize=8,
        markeredgewidth=1.8,
        color=ORANGE,
        path_effects=outline(),
        label=text,
    )
    return [ring, cross]
