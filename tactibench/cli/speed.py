"""``tactibench speed``: the ways in which a model can compute, timed against each other."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.options import json_option, request_of, request_options, save_json
from tactibench.errors import UserError

if TYPE_CHECKING:
    from tactibench.run import Reporter, RunPlan

UNTRAINED = "RANDOM WEIGHTS: their answers say nothing, and reading them may take another time"


@click.command()
@click.argument("model")
@click.option("--protocol", default="exp1", show_default=True, help="Whose weights and frames.")
@request_options(regime="Frames the weights were trained on; default: the protocol's first.")
@click.option("--train", is_flag=True, help="Train the weights where they are not in the cache.")
@click.option("--untrained", is_flag=True, help="Time random weights; errors then say nothing.")
@click.option(
    "--compile", "compiled", is_flag=True, help="Try torch.compile, too: needs a compiler."
)
@click.option(
    "--frames",
    type=click.IntRange(min=1),
    default=100,
    show_default=True,
    help="Test frames that are answered.",
)
@click.option(
    "--calls",
    type=click.IntRange(min=10),
    default=300,
    show_default=True,
    help="Timed calls at batch 1.",
)
@json_option
def speed(
    model: str,
    protocol: str,
    train: bool,
    untrained: bool,
    compiled: bool,
    frames: int,
    calls: int,
    json_file: Path | None,
    **options: Any,
) -> None:
    """Time the ways in which MODEL can compute: float32, folded, frozen, bf16, ONNX Runtime.

    All are timed in turns in one run, one frame a call and in batches, and their answers are
    compared with those in float32. The fastest whose mean error is that of float32 within 2 % is
    named: runs choose in the same way what they time.
    """
    from tactibench.cli.output import Terminal
    from tactibench.frames import true_answers
    from tactibench.plugins import PluginHost
    from tactibench.records import cache_folder
    from tactibench.report import print_race
    from tactibench.run import (
        environment_facts,
        make_plan,
        metric_rows,
        open_frames,
        race,
        race_steps,
    )

    if train and untrained:
        raise UserError("--train and --untrained exclude each other; leave one of them out.")
    request = request_of(protocol, model, options, limit=frames)
    plan = make_plan(request, PluginHost(), cache_folder())
    terminal = Terminal()
    timed = _model(plan, terminal, train=train, untrained=untrained)
    sets = [open_frames(frame_set, terminal) for frame_set in plan.frames.test]
    seen = [frame for presses in sets for frame in presses.frames]
    facts = environment_facts()
    chosen = plan.components.model
    subject = (
        f"{chosen.label} on {plan.device}, {len(seen)} test frames of {plan.spec.id}; "
        f"{facts['cpu']}, fingerprint {facts['fingerprint']}"
    )
    note = UNTRAINED if untrained else ""
    with terminal.task("time", race_steps(timed)) as advance:
        finished = race(
            timed,
            seen,
            true_answers(plan.spec, sets),
            calls=calls,
            compiled=compiled,
            advance=advance,
        )
    print_race(terminal.out, finished, subject, note)
    save_json(
        json_file,
        {
            "model": chosen.component.identity,
            "untrained": untrained,
            "environment": facts,
            "default": finished.best.name,
            "configurations": [
                {
                    "name": way.name,
                    "words": way.description,
                    **way.difference.as_row(),
                    "allowed": way.difference.allowed,
                }
                for way in finished.configurations.usable
            ],
            "skipped": dict(finished.configurations.skipped),
            "speed": list(finished.rows),
            "metrics": metric_rows(finished),
        },
    )


def _model(plan: RunPlan, reporter: Reporter, *, train: bool, untrained: bool) -> Any:
    """Return the model with the weights that were asked for. Raises UserError without any."""
    from tactibench.run import no_weights, train_model

    name = plan.components.model.name
    if untrained:
        model = plan.components.build_model(plan.context())
        if not model.configurations:
            raise UserError(f"model {name!r} has no random weights to time; take --train instead.")
        return model
    if not (train or plan.weights.cached):
        raise no_weights(plan, ", or add --train, or time random weights with --untrained")
    return train_model(plan, reporter)[0]
