"""``tactibench data generate``: press a sensor and keep the frames."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.errors import UserError

if TYPE_CHECKING:
    from tactibench.cli.output import Terminal
    from tactibench.datasets.generating.press import Source
    from tactibench.datasets.generating.stretches import Pressing
    from tactibench.protocols.loader import LoadedProtocol

SENSOR = "tactip-127"
"""Where no protocol names one."""


@click.command()
@click.argument("protocol", required=False)
@click.option("--plan", type=click.Path(path_type=Path), help="Press the lines of a plan.jsonl.")
@click.option("--sensor", help="Sensor that is pressed; default: the protocol's.")
@click.option("--param", "params", multiple=True, metavar="sensor.NAME=VALUE", help="Set one.")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True,
              metavar="DIR", help="Folder of the data set.")  # fmt: skip
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
    from tactibench.datasets.generating.press import generate as write
    from tactibench.datasets.generating.press import is_complete
    from tactibench.datasets.v1 import is_dataset

    pressing, source = _asked(protocol, plan, sensor, params, count, seed)
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
    from tactibench.datasets.v1 import open_dataset

    begun = open_dataset(out)
    for sentence in begun.repaired:
        terminal.say(f"{out}: {sentence}")
    if begun.header.status == "open":
        terminal.say(f"{out}: {len(begun.samples):,} of {total:,} samples are there, going on")


def _asked(
    protocol: str | None,
    plan: Path | None,
    sensor: str | None,
    params: tuple[str, ...],
    count: int | None,
    seed: int | None,
) -> tuple[Pressing, Source]:
    """What is pressed, and what presses it. Raises UserError."""
    from tactibench.datasets.generating.protocol import from_protocol
    from tactibench.datasets.generating.stretches import from_file
    from tactibench.plugins.interfaces import SensorContext
    from tactibench.protocols.loader import load_protocol

    if (protocol is None) == (plan is None):
        raise UserError(
            "name what is to be pressed: either a protocol, such as exp1, or --plan FILE."
        )
    loaded = None if protocol is None else _seeded(load_protocol(protocol), seed)
    default = SENSOR if loaded is None else loaded.keys.defaults.sensor
    source = _source(sensor or default, params)
    asked: dict[str, Any] = {"importer": "tactibench data generate", "count": count}
    if loaded is None:
        assert plan is not None, "checked above"  # noqa: S101
        pressing = from_file(plan, seed or 0, count)
        asked |= {"plan": plan.name, "seed": seed or 0}
    else:
        import numpy as np

        built = source.build(SensorContext(np.random.SeedSequence(0)))
        pressing = from_protocol(loaded.keys, built, count)
        asked |= {"protocol": loaded.label, "sha256": loaded.hash, "seed": loaded.keys.data_seed}
    return pressing, source.with_asked(asked)


def _seeded(protocol: LoadedProtocol, seed: int | None) -> LoadedProtocol:
    """The protocol with another seed of its presses."""
    from dataclasses import replace

    if seed is None:
        return protocol
    return replace(protocol, keys=protocol.keys.model_copy(update={"data_seed": seed}))


def _source(name: str, params: tuple[str, ...]) -> Source:
    """The sensor of that name with its parameters. Raises UserError for one that needs data."""
    from tactibench.datasets.generating.press import source_of
    from tactibench.plugins.host import PluginHost
    from tactibench.running.request import read_parameters

    host = PluginHost()
    spec = host.sensors[name]
    if spec.needs_data:
        raise UserError(
            f"sensor {name!r} presses nothing, it reads what was recorded; take "
            "`tactibench data import`."
        )
    given = read_parameters(params)
    for kind in set(given) - {"sensor"}:
        raise UserError(f"only the sensor has parameters here, --param names {kind}; leave it out.")
    return source_of(spec, spec.settings(given.get("sensor", {})))
