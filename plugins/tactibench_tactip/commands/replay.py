"""``tactibench hw replay``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np

from tactibench import UserError
from tactibench.datasets import open_dataset
from tactibench_tactip.commands.output import (
    device_options,
    json_option,
    number_option,
    open_devices,
    print_rows,
    progress_bar,
    write_figures,
)
from tactibench_tactip.plan import is_mounted, spread_evenly, with_smallest_turn
from tactibench_tactip.station import Station
from tactibench_tactip.touch import find_touch


@click.command("replay")
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False, exists=True))
@device_options
@number_option("--count", click.IntRange(min=1), 10, "Presses, evenly spread over the data set.")
@json_option
def command(folder: Path, count: int, json_file: Path | None, **device: Any) -> None:
    """Press some samples of a data set again and compare the frames with the stored ones.

    What differs by more than the noise of a frame has changed since: the skin wore, a mount moved,
    the light is another one.
    """
    dataset = open_dataset(folder)
    rows, figures = [], []
    with open_devices(**device) as (settings, _):
        usable = [
            (sample, with_smallest_turn(sample.scene))
            for sample in dataset.samples
            if sample.status == "ok"
            and sample.scene is not None
            and is_mounted(settings.indenter, sample.scene.indenter)
        ]
        if not usable:
            raise UserError(f"{folder} has no good sample of the indenter that is mounted.")
        picked = spread_evenly(usable, count)
        station = Station(settings)
        station.check_scenes(f"{folder}", [scene for _, scene in picked])
        with station, progress_bar("press", len(picked)) as advance:
            noise = station.look_at_rest().between
            find_touch(station, first=True)
            for sample, scene in picked:
                result, reason = station.press_checked(scene)
                stored = dataset.image(sample)
                if stored.shape != result.check.image.shape:
                    raise UserError(
                        f"{folder} holds frames of {stored.shape[1]} x {stored.shape[0]} px, the "
                        "camera gives others; take the configuration it was recorded with."
                    )
                change = float(np.abs(result.check.image.astype(float) - stored).mean())
                depth = result.scene.pose.depth - scene.pose.depth
                rows.append((str(sample.id), f"{change:.2f}", f"{depth:+.3f}", reason))
                figures.append(("change", str(sample.id), change, "grey levels"))
                advance(1)
    print_rows(("id", "mean change, grey levels", "depth against then, mm", ""), rows)
    mean = sum(value for _, _, value, _ in figures) / len(figures)
    click.echo(f"mean change {mean:.2f} grey levels; two frames at rest differ by {noise:.2f}")
    write_figures(json_file, figures)
