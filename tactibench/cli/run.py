"""``tactibench run``, ``sweep``, ``score`` and ``weights``: what makes runs and scores them."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.options import (
    MODEL,
    PROTOCOL,
    RUN,
    board_option,
    full_option,
    json_option,
    output_file,
    request_of,
    request_options,
    runner_option,
    save_json,
    store_option,
)
from tactibench.errors import UserError

if TYPE_CHECKING:
    from tactibench.cli.output import Terminal
    from tactibench.records import StoredRun
    from tactibench.run import RunPlan


@click.command()
@click.argument("protocol", type=PROTOCOL)
@click.option(
    "--model",
    "models",
    type=MODEL,
    required=True,
    help="Model to score, or several with commas between them; mean and nearest are baselines.",
)
@request_options(
    encoder="Heatmap encoder, for models that use one.",
    seeds="Of training; with several, the models are ranked among each other.",
)
@click.option(
    "--quick", is_flag=True, help="200 presses, 2 epochs, 40 tests: only proves the path."
)
@click.option("--limit", type=click.IntRange(min=1), help="Score at most this many test presses.")
@click.option(
    "--presses",
    type=click.IntRange(min=1),
    help="Learn from so many presses only; such a run is for the learning curve.",
)
@click.option(
    "--test",
    "test",
    multiple=True,
    metavar="reference|sensor.NAME=VALUE|shots=N|data=FOLDER",
    help="Test on other frames than the model is trained for: the sensor's reference scenes, a "
    "sensor with other parameters, after N labelled single presses of it, or (protocol transfer) "
    "the recording of another sensor.",
)
@click.option(
    "--hidden-seed",
    is_flag=True,
    help="Test on presses drawn from the secret seed in TACTIBENCH_HIDDEN_SEED.",
)
@click.option(
    "--published",
    "published",
    type=click.Path(path_type=Path, dir_okay=False, exists=True),
    help="Released answers to the test frames; default: looked for beside --data.",
)
@runner_option
@json_option
@store_option
@board_option
@full_option
@click.option("--train-only", is_flag=True, help="Train and keep the weights; test nothing.")
@click.option(
    "--fresh", is_flag=True, help="Make everything anew: frames, weights, answers and times."
)
@click.option("--dry-run", is_flag=True, help="Print the plan and stop.")
def run(
    protocol: str,
    models: str,
    seeds: tuple[int, ...],
    json_file: Path | None,
    store: Path,
    board_folder: Path,
    full: bool,
    train_only: bool,
    fresh: bool,
    dry_run: bool,
    **options: Any,
) -> None:
    """Run PROTOCOL (such as exp1, exp2, fine, surface or a .toml file) with a model; score it.

    Prints about ten lines: errors, misses, speed, and the place on the board; --full prints all.
    Frames and weights are cached and shared; an interrupted run continues by the same command.
    Several models and seeds are run one after the other: --model cnn,unet --seeds 0,1,2.
    """
    from tactibench import api
    from tactibench.cli.output import Terminal, show_run
    from tactibench.report import print_ranked
    from tactibench.run import execute

    terminal, names = Terminal(), dict.fromkeys(name.strip() for name in models.split(","))
    plans = [
        api.plan(protocol, name, seed=seed, store=store, **options)
        for name in names
        for seed in seeds
    ]
    values: list[dict[str, Any]] = []
    finished: list[StoredRun] = []
    for plan in plans:
        if train_only and not dry_run:
            values.append(_train(plan, terminal, fresh=fresh))
            continue
        if dry_run or not terminal.quiet:
            for line in plan.lines(fresh=fresh):
                terminal.say(line)
        if not dry_run:
            run = execute(plan, terminal, fresh=fresh)
            show_run(terminal, run, board_folder, full=full, seeds=finished)
            finished.append(run)
            values.append(run.record.json_values())
    if len(finished) > 1:
        print_ranked(terminal.out, finished)
    if values:
        save_json(json_file, values if len(plans) > 1 else values[0])


def _train(plan: RunPlan, terminal: Terminal, *, fresh: bool) -> dict[str, Any]:
    """Train a model, say how and where its weights are, and return these facts."""
    from tactibench.report import duration
    from tactibench.run import train_model

    _, trained = train_model(plan, terminal, fresh=fresh)
    for fold in plan.frames.folds:
        train_model(plan.of_fold(fold), terminal)

    how = "found in the cache, trained" if trained.reused else "trained"
    model, regime = plan.components.model.label, plan.components.regime
    seed, report = plan.request.seed, trained.report
    terminal.say(
        f"{model} ({regime}), seed {seed}: {how} {report['epochs']} epochs on "
        f"{plan.frames.count('fit'):,} presses in {duration(report['seconds'])}"
    )
    terminal.say(f"weights {trained.hash[:8]} in {trained.folder}")
    facts = {"model": model, "regime": regime, "seed": seed, "weights": trained.hash}
    cost = {"training_s": report["seconds"], "epochs": report["epochs"]}
    return {**facts, "reused": trained.reused, **cost}


@click.command()
@click.argument("run_name", metavar="RUN", type=RUN)
@store_option
@board_option
@full_option
@json_option
@click.pass_context
def score(
    ctx: click.Context,
    run_name: str,
    store: Path,
    board_folder: Path,
    full: bool,
    json_file: Path | None,
) -> None:
    """Score the stored predictions of RUN (a name in the store, or a folder) again.

    Neither model nor sensor is used. Says whether the numbers equal the stored ones; exit code 1
    when they do not. Answers that had no score yet are scored, and their run is stored.
    """
    from tactibench import api
    from tactibench.cli.output import Terminal, show_run

    terminal = Terminal()
    scored = api.score(run_name, store)
    show_run(terminal, scored.run, board_folder, full=full)
    record = scored.run.record
    save_json(json_file, record.json_values())
    if scored.completed:
        terminal.say(f"scored: {len(record.metrics)} rows; the run is now in the store")
        return
    if scored.differences:
        for line in scored.differences[:20]:
            terminal.say(line)
        ctx.exit(1)
    terminal.say(f"scored again: all {len(record.metrics)} rows are identical to the stored ones")


FAILED = 1
RETRIES = 2


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--scheduler", metavar="ADDRESS", help="Of a running dask scheduler, tcp://...")
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Processes on this machine; default: as many as it has cores.",
)
@click.option(
    "--threads",
    type=click.IntRange(min=1),
    help="Of each process; default: the cores shared among them.",
)
@click.option(
    "--retries",
    type=click.IntRange(min=0),
    default=RETRIES,
    show_default=True,
    help="How often a cell whose worker died is run again.",
)
@json_option
@store_option
@click.option("--dry-run", is_flag=True, help="List the cells, done and to do, and stop.")
def sweep(
    file: Path,
    scheduler: str | None,
    workers: int | None,
    threads: int | None,
    retries: int,
    json_file: Path | None,
    store: Path,
    dry_run: bool,
) -> int:
    """Run all cells of FILE: protocol x model x regime x encoder x sensor x seed.

    What is in the store is not run again, and the same command continues an interrupted sweep.
    Ends with code 1 when a cell failed; the others have been run.

    \b
    protocol = ["exp1", "exp2"]
    model = ["mean", "cnn", "unet, width=32"]
    seed = [0, 1, 2]
    [[exclude]]
    model = "cnn"
    protocol = "exp2"
    """
    from tactibench.cli.output import Terminal
    from tactibench.plugins import PluginHost
    from tactibench.records import cache_folder
    from tactibench.report import print_sweep
    from tactibench.run import fingerprint
    from tactibench.sweep import (
        Storage,
        list_cells,
        local_client,
        plan_cells,
        read_sweep,
        remote_client,
        result_rows,
        run_cells,
    )

    if scheduler is not None and (workers or threads):
        raise UserError(
            "--workers and --threads are for processes on this machine; leave them out with "
            "--scheduler, whose workers were started with theirs."
        )
    cells = list_cells(read_sweep(file), PluginHost())
    any_machine = scheduler is not None
    storage = Storage(store.resolve(), cache_folder().resolve(), any_machine=any_machine)
    terminal = Terminal()
    with nullcontext() if scheduler is None else remote_client(scheduler, storage) as remote:
        states = plan_cells(cells, storage, remote)
        to_do = sum(state.state == "to do" for state in states.values())
        if to_do and not dry_run:
            cores: int = fingerprint()["cores_logical"]
            count = workers or min(cores, to_do)
            share = threads or max(1, cores // count)
            local = nullcontext(remote) if remote else local_client(count, share, retries)
            with local as client:
                states = run_cells(states, client, storage, terminal)
    print_sweep(terminal.out, states, storage.store)
    if json_file is not None:
        save_json(json_file, result_rows(states, storage.store))
    return FAILED if any(state.why for state in states.values()) else 0


CHECKED_FRAMES = 50
"""Test frames on which an ONNX file is compared with its model."""


@click.group()
def weights() -> None:
    """Hand trained weights on as a file: tactibench weights export unet --out unet.zip."""


@weights.command("export", short_help="write trained weights into a file, or a network as ONNX")
@click.argument("model", type=MODEL)
@click.option("--protocol", default="exp1", show_default=True, help="Whose weights.")
@request_options(
    regime="Frames the weights were trained on; default: the protocol's first.", seed="Of training."
)
@click.option("--presses", type=click.IntRange(min=1), help="Learned from so many presses only.")
@output_file("--out", suffixes=(".zip",), metavar="FILE.zip", help="Weights, to be opened.")
@output_file(
    "--onnx",
    suffixes=(".onnx",),
    metavar="FILE.onnx",
    help="The network alone, for other programs.",
)
@click.option(
    "--license", "license_text", default="not stated", help="Of the weights; the file states it."
)
def export(
    model: str,
    protocol: str,
    out: Path | None,
    onnx: Path | None,
    license_text: str,
    presses: int | None,
    **options: Any,
) -> None:
    """Write the trained weights of MODEL from the cache into a file.

    `tactibench demo`, `hw live` and tactibench.lab.open_weights open it. An ONNX file is written
    only where its answers are those of the model.
    """
    if out is None and onnx is None:
        raise UserError("nothing is to be written; name a file with --out, --onnx or both.")
    from tactibench.cli.output import Terminal
    from tactibench.plugins import PluginHost
    from tactibench.records import cache_folder, file_hash
    from tactibench.run import export_weights, make_plan

    request = request_of(protocol, model, options, presses=presses, limit=CHECKED_FRAMES)
    plan = make_plan(request, PluginHost(), cache_folder())
    terminal = Terminal()
    if out is not None:
        description = export_weights(plan, out, license_text=license_text)
        terminal.say(f"{out}: weights {description.hash[:8]}, sha256 {file_hash(out)}")
    if onnx is not None:
        _export_onnx(plan, onnx, terminal)


def _export_onnx(plan: RunPlan, path: Path, terminal: Terminal) -> None:
    from tactibench.report import number
    from tactibench.run import export_onnx, no_weights, open_frames, train_model

    label = plan.components.model.label
    if not plan.weights.cached:
        raise no_weights(plan)
    model, trained = train_model(plan, terminal)
    sets = [open_frames(frame_set, terminal) for frame_set in plan.frames.test]
    frames = [frame for presses in sets for frame in presses.frames]
    facts = {"model": label, "weights": trained.hash, "source": "tactibench weights export"}
    check = export_onnx(model, frames, path, facts)
    shape = " x ".join("N" if size is None else str(size) for size in check.inputs)
    terminal.say(
        f"{path}: inputs {shape}; answers to {check.frames} frames equal those of {label} "
        f"within {number(check.largest_mm, 6)} mm, its outputs within {check.largest_share:.1e}"
    )
