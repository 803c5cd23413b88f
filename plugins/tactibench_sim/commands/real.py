"""The command `tactibench sim real` and its picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from tactibench_sim.real.comparison import Comparison

REAL_COLOUR, SIMULATED_COLOUR = "#000000", "#D55E00"
TILT_RANGES = ((-21.0, -10.0), (-5.0, 5.0), (10.0, 21.0))
"""Ranges of tilt, deg, of the presses that are drawn."""
_MARGIN_PX = 22.0


@click.command(
    name="real",
    short_help="fit the simulator to real plate presses, and compare",
    help="Fit the simulator to recorded plate presses in DIR (targets.csv and frames_bw, as in the "
    "Tac-VGNN sets) and report how far the simulated pins are from the real ones on the others.",
)
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), help="Picture (PNG).")
@click.option(
    "--fit",
    "fit_on",
    type=click.IntRange(min=100),
    default=400,
    show_default=True,
    help="Presses to fit on.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Which presses these are.",
)
@click.option(
    "--keep",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE.json",
    help="Write the fit for sensors fitted-127 and fitted-331: "
    "--param sensor.calibration=FILE.json.",
)
@click.option(
    "--json",
    "json_file",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Write every number.",
)
def real(
    folder: Path,
    out: Path | None,
    fit_on: int,
    seed: int,
    keep: Path | None,
    json_file: Path | None,
) -> None:
    """Fit, compare, print, and write what is asked for."""
    import json

    from tactibench import UserError
    from tactibench_sim.real.comparison import compare

    for path in (out, keep, json_file):
        if path is not None and not path.resolve().parent.is_dir():
            raise UserError(f"the folder {path.parent} of {path.name} is not there; make it first.")
    comparison = compare(folder, fit_on=fit_on, seed=seed)
    if out is not None:
        draw(out, comparison)
    if keep is not None:
        comparison.calibration.write(keep)
    if json_file is not None:
        json_file.write_text(json.dumps(comparison.numbers(), indent=1) + "\n", encoding="utf-8")
    _print(comparison)


def _print(comparison: Comparison) -> None:
    click.echo(
        f"dome {comparison.fit.kind}, fitted to {comparison.fitted_on} presses; all pins matched "
        f"in {comparison.complete:.1%} of the frames\n"
        f"{'unknown':18s} {'value':>9s} {'+-':>8s}  (when a quarter of the tilts is left out)"
    )
    for name, value in vars(comparison.fit.unknowns).items():
        click.echo(f"  {name:16s} {value:9.3f} {comparison.spread[name]:8.3f}")
    labels = comparison.calibration.label_fit
    if labels is not None:
        click.echo(
            f"from the labels and the spread of the pins alone, as records state indentation: "
            f"depth_offset_mm {labels.depth_offset_mm:.3f}, pivot_mm {labels.pivot_mm:.3f}, "
            f"pivot_side_mm {labels.pivot_side_mm:.3f}"
        )
    for title, rows in (
        ("held-out blocks", comparison.rows),
        ("fitted blocks", comparison.fitted_rows),
    ):
        click.echo(
            f"\n{title:24s} {'n':>5s} {'relative':>9s} {'known':>6s} {'gain':>5s} "
            f"{'px':>6s} {'of px':>6s}"
        )
        for row in rows:
            click.echo(
                f"{row.group:24s} {row.presses:5d} {row.relative:9.3f} {row.known:6.3f} "
                f"{row.gain:5.2f} {row.pixels:6.2f} {row.moved:6.2f}"
            )
    click.echo(
        "\nrelative: |simulated - real| / |real| over all pins, median over presses, from the "
        "labels alone\n"
        "known: where the frame decides whether the plate dragged the skin, which it did in "
        f"{comparison.dragged_share:.0%}\n"
        "fitted blocks: all their presses, fitted or not\n"
        "gain: how much farther the real pins move than the simulated ones, drag known"
    )


def representative_presses(comparison: Comparison) -> list[int]:
    """Return rows of two presses each at tilts about -15, 0 and 15 deg: shallow and deep.

    They are not picked by hand: from each group it is the press whose relative error is the median.
    """
    import numpy as np

    labels, relative = comparison.presses.labels, comparison.from_labels.relative
    is_deep = labels.depth > np.median(labels.depth)
    rows: list[int] = []
    for deep in (False, True):
        for low, high in TILT_RANGES:
            group = np.flatnonzero((labels.tilt > low) & (labels.tilt < high) & (is_deep == deep))
            if len(group):
                order = group[np.argsort(relative[group], kind="stable")]
                rows.append(int(order[len(order) // 2]))
    return rows


def draw(path: Path, comparison: Comparison) -> None:
    """Write a PNG of six presses: real arrows in black, simulated ones on them in orange."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from tactibench_sim.real.plate import indentation

    presses, errors = comparison.presses, comparison.from_labels
    figure = Figure(figsize=(13, 9.2), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    depth = indentation(comparison.fit.unknowns, presses.labels)
    rows = representative_presses(comparison)
    axes = figure.subplots(2, 3, squeeze=False).ravel()
    for axis in axes[len(rows) :]:
        axis.set_visible(False)
    for axis, row in zip(axes, rows, strict=False):
        _arrows(axis, presses.rest, errors.real[row], REAL_COLOUR, 0.0055)
        _arrows(axis, presses.rest, errors.sim[row], SIMULATED_COLOUR, 0.0028)
        axis.set_title(
            f"{presses.names[row]}: {depth[row]:.1f} mm, tilt {presses.labels.tilt[row]:.0f} deg, "
            f"error {errors.relative[row]:.0%}",
            fontsize=10,
        )
        axis.set_aspect("equal")
        (left, top), (right, bottom) = presses.rest.min(axis=0), presses.rest.max(axis=0)
        axis.set_xlim(left - _MARGIN_PX, right + _MARGIN_PX)
        axis.set_ylim(bottom + _MARGIN_PX, top - _MARGIN_PX)
        axis.tick_params(labelsize=9)
    figure.supylabel("row, px", fontsize=11)
    figure.supxlabel("column, px", fontsize=11)
    figure.suptitle(
        "pin displacements of held-out plate presses: real (black) and simulated (orange)\n"
        f"median relative error {comparison.rows[0].relative:.3f} over {len(presses)} presses",
        fontsize=13,
    )
    figure.savefig(path)


def _arrows(axis: Any, rest: Any, moved: Any, colour: str, width: float) -> None:
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
