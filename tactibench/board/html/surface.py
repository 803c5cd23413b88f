"""A predicted heatmap in relief, beside the true displacement of the skin, as a run kept them.

Heatmaps are those that were scored: no weights are loaded and nothing is predicted again.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactibench.board.html.figure import Figure, Option, Panel, Trace
from tactibench.board.html.material import Board
from tactibench.board.rows import Row
from tactibench.contacts import FloatArray
from tactibench.errors import UserError
from tactibench.metrics.trials import Trials
from tactibench.records.store import StoredRun

MODELS = 2
"""Rows with heatmaps that are opened, the best first: a run's heatmaps take 4 to 16 MB."""
LACKING = (
    "No heatmap in relief: heatmaps are kept with stored runs, not with committed records. Run a "
    "model that has them, such as `tactibench run {} --model unet`, and make the report with "
    "`--store runs`."
)


def relief(rows: Sequence[Row], board: Board) -> Panel | None:
    """A choice of rows; None where no stored run has heatmaps."""
    options: list[Option] = []
    for row in rows:
        run = board.runs.get(row.first.name)
        if run is not None and len(options) < MODELS and (option := _option(row, run, board)):
            options.append(option)
    if not options:
        return None
    caption = (
        "The heatmap of a model, as scored, and the true inward displacement of the skin where the "
        "sensor knows it, on the same scale; the first test frame with the most contacts. Drag to "
        "turn."
    )
    return Panel("Predicted heatmap in relief", caption, tuple(options), "model")


def _option(row: Row, run: StoredRun, board: Board) -> Option | None:
    found = board.answers.get(run.record.name)
    if found is None or not isinstance(found.trials, Trials) or not _has_maps(run):
        return None
    depth, grid = found.keys.workspace.depth_max_mm, found.keys.grid.grid()
    counts = found.trials.true_counts
    try:
        maps = run.arrays("maps")
    except UserError:
        return None
    if any(maps[name].shape != (len(counts), *grid.shape) for name in maps) or "maps" not in maps:
        return None
    frame = int(np.argmax(counts))
    x, y = grid.axes()
    heat = maps["maps"][frame].astype(np.float64) * depth
    figures = [_figure(x, y, heat, "predicted", depth)]
    if "surface" in maps:
        figures.append(_figure(x, y, maps["surface"][frame].astype(np.float64), "true", depth))
    note = f"Seed {run.record.seed}, {found.presses[frame]}, {counts[frame]} contacts."
    return Option(row.label, tuple(figures), note)


def _has_maps(run: StoredRun) -> bool:
    """Without reading them: an archive of nothing has a few bytes."""
    path = run.folder / "maps.npz"
    return path.is_file() and path.stat().st_size > 1000


def _figure(x: FloatArray, y: FloatArray, heat: FloatArray, name: str, depth: float) -> Figure:
    trace: Trace = {
        "type": "surface",
        "x": x.round(3).tolist(),
        "y": y.round(3).tolist(),
        "z": heat.round(3).tolist(),
        "colorscale": "Cividis",
        "cmin": 0,
        "cmax": depth,
        "colorbar": {"title": {"text": "mm"}, "thickness": 12},
        "hovertemplate": "x %{x} mm<br>y %{y} mm<br>%{z} mm<extra></extra>",
    }
    scene = {
        "xaxis": {"title": {"text": "x, mm"}},
        "yaxis": {"title": {"text": "y, mm"}, "autorange": "reversed"},
        "zaxis": {"title": {"text": "mm"}, "range": [0, depth]},
        "aspectmode": "manual",
        "aspectratio": {"x": 1, "y": 1, "z": 0.45},
        "camera": {"eye": {"x": 1.1, "y": 1.2, "z": 0.9}},
    }
    return Figure((trace,), {"scene": scene}, height=420, caption=name)
