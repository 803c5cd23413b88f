"""How far answers drift with the type of number: every model with weights in the cache, encoders.

    python benchmarks/precision.py [--models cnn unet ...] [--frames 128] [--compile] [--json FILE]
    python benchmarks/precision.py --read unet.json cnn.json

A model is asked in every type of number and configuration that works here, in batches of 1, 8, 32
and 128 frames, on 1 and 2 threads (``tactibench speed MODEL --precision``), and compared with
``predict`` in float32, one frame a call, on one thread. An encoder's maps of random contacts are
rounded to each type and read again. Printed as Markdown: of each configuration its largest median
and its largest drift, over all batches and threads. --read prints what ``speed MODEL --precision
--json FILE`` wrote, without asking a model. Models without weights in the cache are named.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tactibench import Contacts, Grid
from tactibench.plugins.host import PluginHost
from tactibench.records.cache import cache_folder
from tactibench.records.files import read_json, write_json
from tactibench.report.drift_report import length, share
from tactibench.run.difference import compare
from tactibench.run.drift import run_drift
from tactibench.run.plan import make_plan
from tactibench.run.reporter import Silent
from tactibench.run.request import RunRequest
from tactibench.run.train import open_frames, trained_model
from tactibench.run.truth import true_answers

MODELS = ("cnn", "unet", "vgnn", "mixture", "superpose")
TYPES = (torch.float64, torch.bfloat16, torch.float16)
GRID = Grid.centred(64, 0.4)
HALF_MM, DEPTHS_MM = 9.0, (0.5, 6.0)

Row = dict[str, Any]


def model_rows(name: str, frames: int, compiled: bool) -> dict[str, Any] | None:
    """What ``speed NAME --precision --json`` holds; None without weights in the cache."""
    request = RunRequest("exp1", name, limit=frames, device="cpu")
    plan = make_plan(request, PluginHost(), cache_folder())
    if not plan.weights.cached:
        return None
    model, _ = trained_model(plan, Silent())
    presses = [open_frames(wanted, Silent()) for wanted in plan.frames.test]
    found = run_drift(
        model,
        [frame for one in presses for frame in one.frames],
        true_answers(plan.protocol.keys, presses),
        compiled=compiled,
    )
    return {"model": {"name": name}, **found.as_json()}


def model_lines(found: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    """A line per configuration."""
    for name, group in groupby(found["drift"], key=lambda row: row["configuration"]):
        rows = list(group)
        medians = [row["median_mm"] for row in rows]
        largest = [row["largest_mm"] for row in rows if row["largest_mm"] is not None]
        shares = [row["share"] for row in rows if row["share"] is not None]
        changes = [row["error_change"] for row in rows if row["error_change"] is not None]
        yield (
            found["model"]["name"],
            name,
            length(max(m for m in medians if m is not None)),
            length(max(largest)),
            share(max(shares, default=None)),
            share(max(changes, key=abs, default=None)),
            str(max(row["other_count"] for row in rows)),
            str(sum(row["not_finite"] for row in rows)),
        )


def encoder_rows(count: int = 200) -> Iterator[Row]:
    """Of every encoder, maps of one contact each, rounded to a type, against those in float32."""
    rng = np.random.default_rng(0)
    truth = [
        Contacts.truth(rng.uniform(-HALF_MM, HALF_MM, (1, 2)), rng.uniform(*DEPTHS_MM, 1))
        for _ in range(count)
    ]
    for spec in PluginHost().encoders:
        encoder = spec.load()()
        maps = encoder.encode_batch(truth, GRID)
        exact = encoder.decode_batch(maps, GRID)
        own = compare(exact, truth)
        for kind in TYPES:
            given = torch.from_numpy(maps).to(kind).double().numpy()
            gap = compare(encoder.decode_batch(given, GRID), exact)
            yield {
                "encoder": spec.name,
                "type": str(kind).removeprefix("torch."),
                "own_error_mm": own.largest_mm,
                "median_mm": gap.median_mm,
                "largest_mm": gap.largest_mm,
                "other_count": gap.other_count,
            }


def markdown(heads: tuple[str, ...], lines: Iterable[tuple[str, ...]]) -> None:
    print("|", " | ".join(heads), "|")
    print("|---|---|" + "--:|" * (len(heads) - 2))
    for line in lines:
        print("|", " | ".join(line), "|")
    print()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--models", nargs="+", default=MODELS)
    parser.add_argument("--frames", type=int, default=128)
    parser.add_argument("--compile", action="store_true", help="try torch.compile, too")
    parser.add_argument("--read", nargs="+", type=Path, help="files of `speed --precision --json`")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    if asked.read:
        models = [read_json(path) for path in asked.read]
    else:
        found = {name: model_rows(name, asked.frames, asked.compile) for name in asked.models}
        models = [one for one in found.values() if one is not None]
        for name in (name for name, one in found.items() if one is None):
            print(f"{name}: no weights in the cache; `run exp1 --model {name} --train-only`\n")
    heads = (
        "model",
        "numbers",
        "median, mm",
        "largest, mm",
        "of its error",
        "error changes",
        "other count",
        "not finite",
    )
    markdown(heads, [line for one in models for line in model_lines(one)])
    for one in models:
        for name, reason in one["skipped"].items():
            print(f"left out: {one['model']['name']}, {name}: {reason.rstrip('.')}")
    print()
    encoders = list(encoder_rows())
    markdown(
        (
            "encoder",
            "maps in",
            "median, mm",
            "largest, mm",
            "largest error in float32, mm",
            "other count",
        ),
        [
            (
                row["encoder"],
                row["type"],
                length(row["median_mm"]),
                length(row["largest_mm"]),
                length(row["own_error_mm"]),
                str(row["other_count"]),
            )
            for row in encoders
        ],
    )
    if asked.json:
        write_json(asked.json, {"models": models, "encoders": encoders})


if __name__ == "__main__":
    main()
