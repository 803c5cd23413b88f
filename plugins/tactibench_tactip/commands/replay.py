"""``tactibench hw replay``."""

from __future__ import annotations

from pathlib import Path

import click

from tactibench_tactip.commands.common import (
    bar,
    config_options,
    devices,
    json_option,
    print_rows,
    write_figures,
)


@click.command("replay")
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False, exists=True))
@config_options
@click.option(
    "--count",
    type=click.IntRange(min=1),
    default=10,
    show_default=True,
    help="Presses, evenly spread over the data set.",
)
@json_option
def command(
    folder: Path, config: Path, emulate: bool, time_scale: float, count: int, json_file: Path | None
) -> None:
    """Press some samples of a data set again and compare the frames with the stored ones.

    What differs by more than the noise of a frame has changed since: the skin wore, a mount moved,
    the light is another one.
    """
    import numpy as np

    from tactibench import UserError
    from tactibench.datasets import open_dataset
    from tactibench_tactip.collecting.plan import check_scenes, eased, fits
    from tactibench_tactip.lab_press import one_press
    from tactibench_tactip.station import Station
    from tactibench_tactip.touch.search import find_touch

    dataset = open_dataset(folder)
    rows, figures = [], []
    with devices(config, emulate, time_scale) as (settings, _):
        usable = [
            sample
            for sample in dataset.samples
            if sample.status == "ok"
            and sample.scene is not None
            and fits(settings.indenter, sample.scene.indenter)
        ]
        if not usable:
            raise UserError(f"{folder} has no good sample of the indenter that is mounted.")
        few = min(count, len(usable))
        picked = [usable[(2 * k + 1) * len(usable) // (2 * few)] for k in range(few)]
        scenes = [eased(sample.scene) for sample in picked if sample.scene is not None]
        station = Station(settings)
        turns = station.owner.robot.turns
        check_scenes(f"{folder}", scenes, settings, station.geometry, turns=turns)
        with station, bar("press", few) as advance:
            noise = station.look_at_rest().between
            find_touch(station, first=True)
            for sample, scene in zip(picked, scenes, strict=True):
                pressed, reason = one_press(station, scene)
                stored = dataset.image(sample)
                if stored.shape != pressed.judged.image.shape:
                    raise UserError(
                        f"{folder} holds frames of {stored.shape[1]} x {stored.shape[0]} px, the "
                        "camera gives others; take the configuration it was recorded with."
                    )
                change = np.abs(pressed.judged.image.astype(float) - stored).mean()
                depth = pressed.scene.pose.depth - scene.pose.depth
                rows.append((str(sample.id), f"{change:.2f}", f"{depth:+.3f}", reason))
                figures.append(("change", str(sample.id), float(change), "grey levels"))
                advance(1)
    print_rows(("id", "mean change, grey levels", "depth against then, mm", ""), rows)
    mean = sum(value for _, _, value, _ in figures) / len(figures)
    click.echo(f"mean change {mean:.2f} grey levels; two frames at rest differ by {noise:.2f}")
    write_figures(json_file, figures)
