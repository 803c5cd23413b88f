"""A trained network as an ONNX file, with a check that its answers are those of the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from tactibench.contacts import Answer, Contacts, Frame, PlatePose
from tactibench.errors import UserError
from tactibench.plugins import Model
from tactibench.records import atomic

MOST_MM = 1e-3
"""Largest difference of the file's answers, mm: a thirtieth of the best network's error. float32
sums in another order move answers by about a millionth of a millimetre."""
MOST_SHARE = 1e-3
"""Largest difference of raw outputs, as a share of the largest output. It is checked because a
frame without a contact proves nothing about answers."""


@dataclass(frozen=True)
class OnnxCheck:
    """The differences between a file and its model.

    Attributes:
        frames: Number of frames that both answered.
        largest_share: Largest difference of raw outputs, as a share of the largest output.
        largest_mm: Largest difference of x, y and depth of a contact, mm; for a plate of depth, mm,
            and tilt, deg.
        inputs: Shape of the inputs; the first entry is the number of frames, None for any number.
        outputs: Shape of the outputs of one frame.
    """

    frames: int
    largest_share: float
    largest_mm: float
    inputs: tuple[int | None, ...]
    outputs: tuple[int, ...]


def export_onnx(
    model: Model, frames: Sequence[Frame], path: Path, facts: dict[str, str]
) -> OnnxCheck:
    """Write the network of a model as an ONNX file, if its answers are those of the model.

    The steps before and after the network are not in the file: ``model.inputs(frames)`` makes the
    inputs of the network, and ``model.answers(outputs)`` reads its outputs.

    Args:
        model: A trained model.
        frames: Frames that both answer.
        path: The file that is written.
        facts: Texts that the file holds about itself.

    Raises:
        UserError: The model is no network, ONNX is not installed, the network cannot be exported,
            or the answers differ.
    """
    from tactibench.training import LearnedModel, onnx_model

    name = type(model).__name__
    if not isinstance(model, LearnedModel):
        raise UserError(
            f"{name} is no network and has no ONNX form; take a network such as unet or cnn, "
            "or hand on its weights with --out."
        )
    if not (find_spec("onnx") and find_spec("onnxruntime")):
        raise UserError(
            "ONNX is not installed; run `pip install 'tactibench[onnx]'` and try again."
        )
    import torch

    inputs, network = model.inputs(frames), model.fold(model.network, "float32").cpu()
    free, single = len(inputs), 1
    for count in (free, single):  # some graphs hold the number of frames that they were traced with
        try:
            content = _with_facts(onnx_model(network, inputs[: min(2, count)]), facts, count == 1)
            raw = _computed(content, inputs.numpy(), count)
            break
        except Exception as error:  # noqa: BLE001 - exporters raise whatever they like
            first = (str(error).strip().splitlines() or [type(error).__name__])[0]
            why = error
    else:
        raise UserError(f"the network of {name} cannot be exported: {first[:200]}.") from why
    with torch.inference_mode():
        wanted = network(inputs).numpy()
    share = float(np.abs(raw - wanted).max() / max(1.0, float(np.abs(wanted).max())))
    answers = model.answers(model.outputs(torch.from_numpy(raw)))
    largest = largest_difference(model.predict(frames), answers)
    if not (largest <= MOST_MM and share <= MOST_SHARE):
        raise UserError(
            f"the ONNX file of {name} answers otherwise than the model (by {largest:.3g} mm, "
            f"its outputs by {share:.2g}) and was not written; report this with the model's name."
        )
    with atomic(path) as stream:
        stream.write(content)
    shape = (None if count > 1 else 1, *inputs.shape[1:])
    return OnnxCheck(len(frames), share, largest, shape, raw.shape[1:])


def largest_difference(answers: Sequence[Answer | None], others: Sequence[Answer | None]) -> float:
    """Return the largest difference of two models' answers to the same frames.

    It is in mm, or in deg for the tilt of plates, and inf where the kinds of answers or the numbers
    of contacts differ.
    """
    return max((_difference(*pair) for pair in zip(answers, others, strict=True)), default=0.0)


def _difference(one: Answer | None, other: Answer | None) -> float:
    if isinstance(one, Contacts) and isinstance(other, Contacts) and len(one) == len(other):
        gaps = np.abs(np.column_stack([one.xy - other.xy, one.depth - other.depth]))
        return float(gaps.max(initial=0.0))
    if isinstance(one, PlatePose) and isinstance(other, PlatePose):
        return max(abs(one.depth - other.depth), abs(one.tilt - other.tilt))
    return 0.0 if one is other is None else float("inf")


def _with_facts(content: bytes, facts: dict[str, str], single: bool) -> bytes:
    """Return the bytes of an ONNX model with texts about itself.

    Args:
        content: Bytes of the model.
        facts: Name -> text.
        single: Whether the model takes one frame at a time, which its inputs and outputs then
            state.
    """
    import onnx

    graph: Any = onnx.load_from_string(content)
    for name, value in facts.items():
        graph.metadata_props.add(key=name, value=value)
    if single:
        for end in (*graph.graph.input, *graph.graph.output):
            end.type.tensor_type.shape.dim[0].dim_value = 1
    serialized: bytes = graph.SerializeToString()
    return serialized


def _computed(content: bytes, inputs: Any, count: int) -> Any:
    """Return the outputs of an ONNX model for (N, ...) inputs, computed ``count`` at a time."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 4  # failures are also raised
    session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    starts = range(0, len(inputs), count)
    rows = [session.run(None, {"inputs": inputs[k : k + count]})[0] for k in starts]
    return np.concatenate(rows)
