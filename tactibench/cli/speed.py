"""``tactibench speed``: the ways in which a model can compute, timed against each other."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.options import json_option, request_of, request_options
from tactibench.errors import UserError

if TYPE_CHECKING:
    from tactibench.run.plan import RunPlan
    from tactibench.run.train import Reporter

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
    "--precision",
    is_flag=True,
    help="Do not time: say how far answers drift in float64, float32, bf16 and fp16.",
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
    precision: bool,
    frames: int,
    calls: int,
    json_file: Path | None,
    **asked: Any,
) -> None:
    """Time the ways in which MODEL can compute: float32, folded, frozen, bf16, ONNX Runtime.

    All are timed in turns in one run, one frame a call and in batches, and their answers are
    compared with those in float32. The fastest whose mean error is that of float32 within 2 % is
    named: runs choose in the same way what they time.

    With --precision nothing is timed. The answers in each type of number, in batches of 1 to 128
    frames, on 1 and 2 threads are compared with those in float32, one frame a call.
    """
    from tactibench.cli.output import Terminal
    from tactibench.plugins.host import PluginHost
    from tactibench.records.cache import cache_folder
    from tactibench.records.files import write_json
    from tactibench.report.race_report import print_race
    from tactibench.run.environment import environment_facts
    from tactibench.run.plan import make_plan
    from tactibench.run.race import metric_rows, run_race, steps
    from tactibench.run.train import open_frames
    from tactibench.run.truth import true_answers

    if train and untrained:
        raise UserError("--train and --untrained exclude each other; leave one of them out.")
    request = request_of(protocol, model, asked, limit=frames)
    plan = make_plan(request, PluginHost(), cache_folder())
    terminal = Terminal()
    timed = _model(plan, terminal, train=train, untrained=untrained)
    keys = plan.protocol.keys
    presses = [open_frames(wanted, terminal) for wanted in plan.frames.test]
    seen = [frame for one in presses for frame in one.frames]
    truth = true_answers(keys, presses)
    facts = environment_facts()
    subject = (
        f"{plan.parts.model.label()} on {plan.device}, {len(seen)} test frames of {keys.id}; "
        f"{facts['cpu']}, fingerprint {facts['fingerprint']}"
    )
    note = UNTRAINED if untrained else ""
    head = {
        "model": {"name": plan.parts.model.name, "parameters": dict(plan.parts.model.values)},
        "untrained": untrained,
        "environment": facts,
    }
    if precision:
        from tactibench.report.drift_report import print_drifts
        from tactibench.run.arithmetic import ways
        from tactibench.run.drift import run_drift

        with terminal.task("precision", len(ways(timed, compiled=compiled)[0])) as advance:
            drifts = run_drift(timed, seen, truth, compiled=compiled, advance=advance)
        print_drifts(terminal.out, drifts, subject, note)
        if json_file is not None:
            write_json(json_file, {**head, **drifts.as_json()})
        return
    with terminal.task("time", steps(timed)) as advance:
        race = run_race(timed, seen, truth, calls=calls, compiled=compiled, advance=advance)
    print_race(terminal.out, race, subject, note)
    if json_file is not None:
        write_json(
            json_file,
            {
                **head,
                "default": race.best.name,
                "configurations": [
                    {
                        "name": one.name,
                        "words": one.words,
                        **one.difference.as_row(),
                        "allowed": one.difference.allowed,
                    }
                    for one in race.found.usable
                ],
                "skipped": dict(race.found.skipped),
                "speed": list(race.rows),
                "metrics": metric_rows(race),
            },
        )


def _model(plan: RunPlan, reporter: Reporter, *, train: bool, untrained: bool) -> Any:
    """The model with the weights that were asked for. Raises UserError where there are none."""
    from tactibench.run.train import trained_model

    name = plan.parts.model.name
    if untrained:
        model = plan.parts.build_model(plan.context())
        if not model.configurations:
            raise UserError(f"model {name!r} has no random weights to time; take --train instead.")
        return model
    if not (train or plan.weights.cached):
        raise UserError(
            f"there are no trained weights of {plan.parts.model.label()} in the cache for this "
            f"request; make them with `tactibench run exp1 --model {name} --train-only` and the "
            "same options, or add --train, or time random weights with --untrained."
        )
    return trained_model(plan, reporter)[0]
