"""Measure how far answers drift with the type of number, for models and encoders.

    python benchmarks/precision.py [--models cnn unet ...] [--frames 128] [--compile] [--json FILE]
    python benchmarks/precision.py --read unet.json cnn.json

A model answers in every type of number and configuration that works on this machine, in batches of
1, 8, 32 and 128 frames, on 1 and 2 threads. Its answers are compared with ``predict`` in float32,
one frame a call, on one thread. The maps of random contacts of an encoder are rounded to each type
and decoded again. Printed as Markdown are the largest median and the largest drift of each
configuration, over all batches and threads. --read prints the files that --json wrote, without
running a model. --untrained takes random weights. Models without weights in the cache are named.
"""

from __future__ import annotations

import argparse
import copy
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.overrides import TorchFunctionMode

from tactibench import Contacts, Frame, Grid, PlatePose, UserError
from tactibench.contacts import Answer
from tactibench.frames import spread, true_answers
from tactibench.plugins import Model, PluginHost, Stage
from tactibench.records import cache_folder, read_json, write_json
from tactibench.run import (
    BATCHES,
    COMPILED,
    NullReporter,
    RunRequest,
    blinded,
    compare,
    limited_threads,
    make_plan,
    mean_error_mm,
    open_frames,
    read_parameters,
    train_model,
)
from tactibench.training import LearnedModel

MODELS = ("cnn", "unet", "vgnn", "mixture", "superpose")
THREADS = (1, 2)
FEW = 32
"""Number of frames, spread over all, that are answered in smaller batches: types that are emulated
are slow."""
COMPILE_S = 60.0
"""Longest time to compile for one shape, s; a configuration that takes longer is left out."""
TYPES = {
    "float64": "float64 throughout the network",
    "bf16": "bf16 products (autocast), normalisation folded, channels_last",
    "fp16": "fp16 products (autocast), normalisation folded, channels_last",
}
"""Types of number of any model that is one network, beside the model's own configurations."""
ENCODER_TYPES = (torch.float64, torch.bfloat16, torch.float16)
GRID = Grid.centred(64, 0.4)
HALF_MM, DEPTHS_MM = 9.0, (0.5, 6.0)

Row = dict[str, Any]
Make = Callable[[Sequence[Frame]], Sequence[Stage]]


# Ways to compute ------------------------------------------------------------------------------


def ways(model: Model, *, compiled: bool = False) -> dict[str, Make]:
    """Return name -> function that makes the stages ready for frames.

    A configuration of the model goes before the type of number of the same name. The type is taken
    where this machine cannot compute the configuration, so that its effect on the answers can be
    measured anywhere. The functions raise UserError with the reason where this machine or model
    cannot compute so.

    Args:
        model: Model that answers.
        compiled: Whether to include the configuration that is compiled.
    """
    names = [name for name in model.configurations if compiled or name != COMPILED]
    makes: dict[str, Make] = {name: partial(model.configured, name) for name in names}
    if not model.configurations:
        makes["default"] = lambda _: model.stages()
    if isinstance(model, LearnedModel):
        for name in TYPES:
            typed = partial(typed_stages, model, name)
            makes[name] = partial(_first_that_works, makes[name], typed) if name in makes else typed
    return makes


def _first_that_works(make: Make, other: Make, frames: Sequence[Frame]) -> Sequence[Stage]:
    with suppress(UserError):
        return make(frames)
    return other(frames)


def typed_stages(model: LearnedModel, name: str, _: Sequence[Frame] = ()) -> list[Stage]:
    """Return the phases of a learned model whose network computes in one of TYPES."""
    forward = _wide(model) if name == "float64" else _narrow(model, name)
    return [("preprocess", model.inputs), ("forward", forward), ("decode", model.answers)]


def _narrow(model: LearnedModel, name: str) -> Callable[[torch.Tensor], Any]:
    """Return the forward pass in mixed arithmetic: products in 16 bits, sums in 32 (autocast).

    Raises:
        UserError: The network cannot be folded for this type.
    """
    device = model.context.device
    kind = {"bf16": torch.bfloat16, "fp16": torch.float16}[name]
    try:
        with torch.no_grad():
            network = model.fold(model.network, "bf16" if name == "bf16" else "float32")
    except RuntimeError as error:
        raise UserError(f"its network cannot be folded for {name}: {error}") from error

    def forward(inputs: torch.Tensor) -> Any:
        with torch.inference_mode(), torch.autocast(device, dtype=kind):
            raw = network(inputs.to(device))
        return model.outputs(raw)

    return forward


class _Wider(TorchFunctionMode):
    """A mode of torch that converts to float64 where a network asks for float32."""

    def __torch_function__(
        self, function: Any, _types: Any, args: Any = (), kwargs: Any = None
    ) -> Any:
        if function is torch.Tensor.float:
            function = torch.Tensor.double
        return function(*args, **(kwargs or {}))


def _wide(model: LearnedModel) -> Callable[[torch.Tensor], Any]:
    """Return the forward pass of a copy of the network with all weights in float64."""
    device = model.context.device
    network = copy.deepcopy(model.network).double().eval()

    def forward(inputs: torch.Tensor) -> Any:
        given = inputs.to(device)
        with torch.inference_mode(), _Wider():
            raw = network(given.double() if given.is_floating_point() else given)
            return model.outputs(raw)

    return forward


# Drift ----------------------------------------------------------------------------------------


def drift_rows(
    model: Model,
    frames: Sequence[Frame],
    truth: Sequence[Answer],
    *,
    batches: Sequence[int] = (),
    threads: Sequence[int] = THREADS,
    compiled: bool = False,
) -> dict[str, Any]:
    """Answer frames in every way that works on this machine, and compare with ``predict``.

    ``predict`` answers in float32, one frame a call, on one thread. Batches that are larger than
    the number of frames are left out; batches smaller than ``FEW`` are tried on ``FEW`` frames.

    Args:
        model: Model that answers.
        frames: Frames of the test.
        truth: The true answer to every frame.
        batches: Sizes of the batches; (): those of ``run.latency``.
        threads: Numbers of threads.
        compiled: Whether to try the configuration that is compiled.

    Returns:
        ``error_mm``, the mean error of the model; ``skipped``, name of a way -> why it was left
        out; and ``drift``, a row for each way, batch and number of threads.
    """
    seen = [blinded(frame) for frame in frames]
    with limited_threads(1):
        scored = [model.predict([frame])[0] for frame in seen]
    error = mean_error_mm(scored, truth)
    rows: list[Row] = []
    skipped: dict[str, str] = {}
    for name, make in ways(model, compiled=compiled).items():
        try:
            for count in threads:
                with limited_threads(count):
                    began = time.monotonic()
                    stages = make(seen[:1])
                    for batch in (batch for batch in batches or BATCHES if batch <= len(seen)):
                        of = spread(range(len(seen)), max(batch, FEW))
                        if name == COMPILED:
                            began = _compile(stages, seen[:batch], began)
                        read = read_all(stages, [seen[row] for row in of], batch)
                        gap = compare(
                            read.pop("answers"), [scored[r] for r in of], [truth[r] for r in of]
                        )
                        share = (
                            gap.median_mm / error if gap.median_mm is not None and error else None
                        )
                        rows.append(
                            {"configuration": name, "batch": batch, "threads": count}
                            | {"median_mm": gap.median_mm, "largest_mm": gap.largest_mm}
                            | {"other_count": gap.other_count, "error_change": gap.error_change}
                            | {"share": share, **read}
                        )
        except UserError as reason:
            skipped[name] = str(reason)
    return {"error_mm": error, "skipped": skipped, "drift": rows}


def _compile(stages: Sequence[Stage], frames: Sequence[Frame], began: float) -> float:
    """Call the stages once, which compiles them, and return the time after it, s.

    Raises:
        UserError: More than COMPILE_S seconds passed since ``began``.
    """
    read_all(stages, frames, len(frames))
    took = time.monotonic() - began
    if took > COMPILE_S:
        raise UserError(
            f"to compile it for {len(frames)} frames took {took:.0f} s, more than the "
            f"{COMPILE_S:.0f} s that are waited for"
        )
    return time.monotonic()


def read_all(stages: Sequence[Stage], frames: Sequence[Frame], batch: int) -> dict[str, Any]:
    """Return the answers to frames, with the number of outputs that are not finite.

    Outputs are the values before the last stage. The answers of a batch that the last stage refuses
    are None, and are counted as "refused".

    Args:
        stages: Phases of the prediction.
        frames: Frames to answer.
        batch: Number of frames of a batch.
    """
    answers: list[Answer | None] = []
    outputs = not_finite = refused = 0
    for start in range(0, len(frames), batch):
        value: Any = list(frames[start : start + batch])
        count = len(value)
        for _, stage in stages[:-1]:
            value = stage(value)
        if isinstance(value, np.ndarray) and value.dtype.kind == "f":
            outputs += value.size
            not_finite += int(value.size - np.isfinite(value).sum())
        try:
            answers += stages[-1][1](value)
        except (UserError, ValueError):  # readers and Contacts refuse values that are not finite
            answers += [None] * count
            refused += count
    plates = [answer for answer in answers if isinstance(answer, PlatePose)]
    not_finite += sum(not np.isfinite([plate.depth, plate.tilt]).all() for plate in plates)
    return {
        "answers": answers,
        "outputs": outputs,
        "not_finite": not_finite,
        "refused": refused,
    }


def model_rows(
    name: str,
    frames: int,
    *,
    compiled: bool = False,
    untrained: bool = False,
    params: Sequence[str] = (),
) -> dict[str, Any] | None:
    """Return the drift of a model; None where the cache does not hold its weights.

    Args:
        name: Name of the model.
        frames: Number of test frames of exp1.
        compiled: Whether to try the configuration that is compiled.
        untrained: Whether to take random weights.
        params: Parameters of the run, as of ``tactibench run --param``.
    """
    parameters = read_parameters(tuple(params))
    request = RunRequest("exp1", name, limit=frames, device="cpu", parameters=parameters)
    plan = make_plan(request, PluginHost(), cache_folder())
    if untrained:
        model = plan.components.build_model(plan.context())
    elif plan.weights.cached:
        model, _ = train_model(plan, NullReporter())
    else:
        return None
    sets = [open_frames(frame_set, NullReporter()) for frame_set in plan.frames.test]
    seen = [frame for presses in sets for frame in presses.frames]
    drift = drift_rows(model, seen, true_answers(plan.spec, sets), compiled=compiled)
    return {"model": {"name": name}, **drift}


def encoder_rows(count: int = 200) -> Iterator[Row]:
    """Yield, for every encoder and type, the drift of contacts decoded from rounded maps."""
    rng = np.random.default_rng(0)
    truth = [
        Contacts.truth(rng.uniform(-HALF_MM, HALF_MM, (1, 2)), rng.uniform(*DEPTHS_MM, 1))
        for _ in range(count)
    ]
    for spec in PluginHost().encoders:
        encoder = spec.load()()
        maps = encoder.encode_batch(truth, GRID)
        exact = encoder.decode_batch(maps, GRID)
        for kind in ENCODER_TYPES:
            rounded = torch.from_numpy(maps).to(kind).double().numpy()
            gap = compare(encoder.decode_batch(rounded, GRID), exact)
            yield {
                "encoder": spec.name,
                "type": str(kind).removeprefix("torch."),
                "own_error_mm": compare(exact, truth).largest_mm,
                "median_mm": gap.median_mm,
                "largest_mm": gap.largest_mm,
                "other_count": gap.other_count,
            }


# Tables ---------------------------------------------------------------------------------------


def model_lines(drift: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    """Yield a line for each configuration: the largest of each column over batches and threads."""
    for name, group in groupby(drift["drift"], key=lambda row: row["configuration"]):
        rows = list(group)

        def known(column: str, rows: Sequence[Row] = rows) -> list[float]:
            return [row[column] for row in rows if row[column] is not None]

        yield (
            drift["model"]["name"],
            name,
            length(max(known("median_mm"), default=None)),
            length(max(known("largest_mm"), default=None)),
            share(max(known("share"), default=None)),
            share(max(known("error_change"), key=abs, default=None)),
            str(max(row["other_count"] for row in rows)),
            str(sum(row["not_finite"] for row in rows)),
        )


def length(value: float | None) -> str:
    """Return mm as text, as a power of ten where five decimals are too few."""
    if value is None:
        return "n/a"
    return f"{value:.5f}" if value == 0 or value >= 1e-4 else f"{value:.1e}"


def share(value: float | None) -> str:
    """Return a share as per cent with two figures."""
    return "n/a" if value is None else f"{100 * value:.2g} %"


def markdown(heads: tuple[str, ...], lines: Iterable[tuple[str, ...]]) -> None:
    print("|", " | ".join(heads), "|")
    print("|---|---|" + "--:|" * (len(heads) - 2))
    for line in lines:
        print("|", " | ".join(line), "|")
    print()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--models", nargs="+", default=MODELS)
    parser.add_argument("--param", nargs="+", default=(), metavar="KIND.NAME=VALUE")
    parser.add_argument("--frames", type=int, default=128)
    parser.add_argument("--compile", action="store_true", help="try torch.compile, too")
    parser.add_argument("--untrained", action="store_true", help="take random weights")
    parser.add_argument("--read", nargs="+", type=Path, help="files that --json wrote")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    if given.read:
        models = [model for path in given.read for model in read_json(path)["models"]]
    else:
        models = []
        for name in given.models:
            drift = model_rows(
                name,
                given.frames,
                compiled=given.compile,
                untrained=given.untrained,
                params=given.param,
            )
            if drift is None:
                print(f"{name}: no weights in the cache; tactibench run exp1 --model {name}\n")
            else:
                models.append(drift)
    heads = ("model", "numbers", "median, mm", "largest, mm", "of its error", "error changes")
    counts = ("other count", "not finite")
    markdown((*heads, *counts), [line for model in models for line in model_lines(model)])
    for model in models:
        for name, reason in model["skipped"].items():
            print(f"left out: {model['model']['name']}, {name}: {reason.rstrip('.')}")
    print()
    encoders = list(encoder_rows())
    errors = ("median, mm", "largest, mm", "largest error in float32, mm")
    markdown(
        ("encoder", "maps in", *errors, "other count"),
        [
            (
                row["encoder"],
                row["type"],
                *(length(row[name]) for name in ("median_mm", "largest_mm", "own_error_mm")),
                str(row["other_count"]),
            )
            for row in encoders
        ],
    )
    if given.json:
        write_json(given.json, {"models": models, "encoders": encoders})


if __name__ == "__main__":
    main()
