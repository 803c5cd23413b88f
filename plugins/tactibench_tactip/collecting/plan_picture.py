"""Where the tool goes: seen along the work frame's z, and from the side."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tactibench_tactip.collecting.plan import Plan, eased
from tactibench_tactip.geometry.press import PressGeometry
from tactibench_tactip.motion.press_moves import way
from tactibench_tactip.settings import Settings


def draw_plan(path: Path, plan: Plan, settings: Settings, geometry: PressGeometry) -> None:
    """Write a PNG with the foremost poses of all presses inside the envelope."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    keys = settings.envelope
    trips = [way(eased(press.scene), geometry, settings) for press in plan.presses]
    down = np.array([trip.down[:3] for trip in trips])
    depth = np.array([press.scene.pose.depth for press in plan.presses])
    figure = Figure(figsize=(10, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    above, side = figure.subplots(1, 2)
    half = keys.half_width_mm
    dots = above.scatter(down[:, 0], down[:, 1], c=depth, s=6, cmap="viridis")
    above.add_patch(Rectangle((-half, -half), 2 * half, 2 * half, fill=False, ls="--"))
    above.set(
        xlabel="x of the work frame, mm",
        ylabel="y, mm",
        aspect="equal",
        title=f"{len(plan):,} presses, tool at its deepest",
    )
    side.scatter(down[:, 0], down[:, 2], c=depth, s=6, cmap="viridis")
    side.axhline(0.0, lw=0.8, color="0.5")
    side.axhline(-keys.clearance_mm, lw=0.8, ls=":", color="0.5")
    side.add_patch(
        Rectangle(
            (-half, -keys.above_mm), 2 * half, keys.above_mm + keys.below_mm, fill=False, ls="--"
        )
    )
    side.set(
        xlabel="x, mm",
        ylabel="z into the object, mm",
        ylim=(keys.below_mm + 2, -keys.clearance_mm - 4),
        title="dashed: the envelope",
    )
    figure.colorbar(dots, ax=side, label="depth, mm")
    figure.savefig(path, dpi=120)
