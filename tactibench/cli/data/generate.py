"""``tactibench data generate``: press a sensor and keep the frames."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from tactibench.cli.output import Terminal


@click.command()
@click.argument("protocol", required=False)
@click.option("--plan", type=click.Path(path_type=Path), help="Press the lines of a plan.jsonl.")
@click.option("--sensor", help="Sensor that is pressed; default: the protocol's.")
@click.option("--param", "params", multiple=True, metavar="sensor.NAME=VALUE", help="Set one.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    metavar="DIR",
    help="Folder of the data set.",
)
@click.option("--count", type=click.IntRange(min=1), help="At most so many presses of every set.")
@click.option("--seed", type=click.IntRange(min=0), help="Other presses and other noise.")
def generate(
    protocol: str | None,
    plan: Path | None,
    sensor: str | None,
    params: tuple[str, ...],
    out: Path,
    count: int | None,
    seed: int | None,
) -> None:
    """Press a sensor as a protocol or a plan says, and write the frames as a data set.

    Of a protocol everything is pressed that it trains, validates and tests on, in all regimes; the
    frames are those of `tactibench run`, and every regime becomes a split. When it is interrupted,
    the same command goes on.

    \b
    tactibench data generate exp1 --out data/exp1
    tactibench data generate exp2 --sensor tactip-331 --count 200 --out data/exp2-331
    tactibench data generate --plan presses.jsonl --out data/grid
    """
    from tactibench.cli.output import Terminal
    from tactibench.datasets import is_dataset
    from tactibench.datasets.generating.asked import Asked
    from tactibench.datasets.generating.press import generate as write
    from tactibench.datasets.generating.press import is_complete

    pressing, source = Asked(protocol, plan, sensor, params, count, seed).found()
    terminal = Terminal()
    total = sum(1 for _ in pressing)
    if is_complete(out, source, pressing):
        terminal.say(f"{out}: complete, {total:,} samples")
        return
    if is_dataset(out):
        _say_begun(terminal, out, total)
    with terminal.task("press", total) as advance:
        write(out, source, pressing, advance)
    terminal.say(f"{out}: {total:,} samples of {source.identity['name']} written")


def _say_begun(terminal: Terminal, out: Path, total: int) -> None:
    from tactibench.datasets import open_dataset

    begun = open_dataset(out)
    for sentence in begun.repaired:
        terminal.say(f"{out}: {sentence}")
    if begun.header.status == "open":
        terminal.say(f"{out}: {len(begun.samples):,} of {total:,} samples are there, going on")
