"""``tactibench weights``: trained weights as a file that can be handed on."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.completion import MODEL
from tactibench.cli.options import output_file, request_of, request_options
from tactibench.errors import UserError

if TYPE_CHECKING:
    from tactibench.cli.output import Terminal
    from tactibench.run import RunPlan

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
