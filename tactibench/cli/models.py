"""``tactibench models``: trained weights, which the experiments share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.options import json_option, request_of, request_options

if TYPE_CHECKING:
    from tactibench.plugins.host import PluginHost
    from tactibench.run.cached_weights import KeptWeights

MIB = 2**20


@click.group()
def models() -> None:
    """List trained weights, or train a model without testing it.

    Weights are kept in the cache and shared by all experiments that train on the same presses.
    """


@models.command("list")
@json_option
def list_weights(json_file: Path | None) -> None:
    """List the trained weights in the cache."""
    from tactibench.cli.output import Terminal
    from tactibench.cli.report.cells import print_grid
    from tactibench.plugins.host import PluginHost
    from tactibench.records.cache import cache_folder
    from tactibench.records.files import write_json
    from tactibench.run.cached_weights import kept_weights

    found = kept_weights(cache_folder())
    if json_file is not None:
        write_json(json_file, [row for kept in found for row in _json(kept)])
    terminal = Terminal()
    if not found:
        terminal.say(f"no trained weights in {cache_folder()}; a run leaves its own there")
        return
    host = PluginHost()
    heads = (
        "model",
        "encoder",
        "regime",
        "presses",
        "seed",
        "device",
        "epochs",
        "training",
        "MiB",
        "folder",
    )
    print_grid(
        terminal.out,
        heads,
        [_cells(kept, host) for kept in found],
        right=frozenset(heads[3:5] + heads[6:9]),
    )
    terminal.say(f"{len(found)} in {cache_folder() / 'weights'}")


@models.command("train")
@click.argument("model")
@click.option("--protocol", default="exp1", show_default=True, help="Whose training presses.")
@request_options()
@click.option("--presses", type=click.IntRange(min=1), help="Learn from so many presses only.")
@json_option
def train_weights(
    model: str,
    protocol: str,
    presses: int | None,
    json_file: Path | None,
    **asked: Any,
) -> None:
    """Train MODEL and keep its weights.

    Runs find them; an interrupted training continues by the same command.
    """
    from tactibench.board.numbers import duration
    from tactibench.cli.output import Terminal
    from tactibench.plugins.host import PluginHost
    from tactibench.records.cache import cache_folder
    from tactibench.records.files import write_json
    from tactibench.run.plan import make_plan
    from tactibench.run.train import trained_model

    request = request_of(protocol, model, asked, presses=presses)
    terminal = Terminal()
    plan = make_plan(request, PluginHost(), cache_folder())
    _, trained = trained_model(plan, terminal)
    report = trained.report
    how = "found in the cache, trained" if trained.reused else "trained"
    terminal.say(
        f"{plan.parts.model.label()} ({plan.parts.regime}), seed {request.seed}: {how} "
        f"{report['epochs']} epochs on {plan.frames.count('fit'):,} presses in "
        f"{duration(report['seconds'])}"
    )
    terminal.say(f"weights {trained.hash[:8]} in {plan.weights.folder}")
    if json_file is not None:
        who = {
            "group": plan.parts.model.label(),
            "regime": plan.parts.regime,
            "seed": request.seed,
            "weights": trained.hash,
            "reused": trained.reused,
        }
        write_json(
            json_file,
            [
                {"metric": "training_s", "value": report["seconds"], "unit": "s", **who},
                {"metric": "epochs", "value": report["epochs"], "unit": "", **who},
            ],
        )


def _label(kept: KeptWeights, host: PluginHost) -> str:
    """The model with the parameters that are not at their defaults, as far as these are known."""
    spec = host.models.specs.get(kept.model)
    defaults = {p.name: p.default for p in spec.parameters} if spec else {}
    other = [
        f"{name}={value}"
        for name, value in kept.parameters.items()
        if name not in defaults or value != defaults[name]
    ]
    return f"{kept.model}({','.join(other)})" if other else kept.model


def _cells(kept: KeptWeights, host: PluginHost) -> tuple[str, ...]:
    from tactibench.board.numbers import duration, number

    presses = "n/a" if kept.presses is None else f"{kept.presses:,}"
    return (
        _label(kept, host),
        kept.encoder or "none",
        kept.regime,
        presses,
        str(kept.seed),
        kept.device,
        str(kept.epochs),
        duration(kept.seconds),
        number(kept.bytes / MIB, 1),
        kept.folder.name,
    )


def _json(kept: KeptWeights) -> list[dict[str, Any]]:
    who = {
        "model": kept.model,
        "parameters": dict(kept.parameters),
        "encoder": kept.encoder,
        "regime": kept.regime,
        "seed": kept.seed,
        "device": kept.device,
        "presses": kept.presses,
        "weights": kept.hash,
        "group": kept.folder.name,
    }
    values = (
        ("training_s", kept.seconds, "s"),
        ("epochs", kept.epochs, ""),
        ("size_bytes", kept.bytes, "B"),
    )
    return [{"metric": name, "value": value, "unit": unit, **who} for name, value, unit in values]
