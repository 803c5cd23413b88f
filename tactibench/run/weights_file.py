"""Trained weights as one file to pass on and to serve, and a network as an ONNX file.

A weights file is a zip without compression: ``weights.json`` (a description) and the files that the
model saved, each with its sha256. Equal weights give equal bytes.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from tactibench import __version__
from tactibench.contacts import Answer, Contacts, Frame, Grid, PlatePose, Sites
from tactibench.errors import UserError
from tactibench.plugins import Model, ModelContext, PluginHost
from tactibench.protocols import first_mistake
from tactibench.records import BoundSpec, atomic, parse_json
from tactibench.run.machine import choose_device
from tactibench.run.plan import RunPlan, no_weights
from tactibench.run.weights import weights_hash

SUFFIX = ".zip"
DESCRIPTION, FOLDER = "weights.json", "weights/"
FIRST_DAY = (1980, 1, 1, 0, 0, 0)
"""Time stamp of every entry: equal weights give equal bytes."""
MOST_MM = 1e-3
"""Largest difference of an ONNX file's answers, mm: a thirtieth of the best network's error. Sums
of float32 in another order move answers by about a millionth of a millimetre."""
MOST_SHARE = 1e-3
"""Largest difference of raw outputs, as a share of the largest output. It is checked because a
frame without a contact proves nothing about answers."""

_PART = r"[A-Za-z0-9_][A-Za-z0-9_-]*(\.[A-Za-z0-9_-]+)*"
FileName = Annotated[str, StringConstraints(pattern=rf"^{_PART}(/{_PART})*$", max_length=200)]
"""A relative path that never leads upwards."""
Cells = Annotated[int, Field(ge=1, le=1024)]
Positive = Annotated[float, Field(gt=0)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class ComponentValues(_Strict):
    """A model or an encoder with the values of all its parameters."""

    name: str
    parameters: dict[str, bool | int | float | str]

    def bound(self, catalogue: Any) -> BoundSpec[Any]:
        """Return the spec with these values. Raises UserError where it is not installed."""
        given = {name: str(value) for name, value in self.parameters.items()}
        spec: BoundSpec[Any] = BoundSpec.named(catalogue, self.name, given)
        return spec


class BuildContext(_Strict):
    """The context in which a model is made (`ModelContext`)."""

    answer: Literal["contacts", "plate", "sites"]
    cells: tuple[Cells, Cells]
    origin_mm: tuple[float, float]
    pitch_mm: Positive
    max_depth_mm: Positive
    transfers: bool


class WeightsDescription(_Strict):
    """The content of ``weights.json``.

    Attributes:
        made_with: Version of tactibench.
        model: The model, with its parameters.
        encoder: The encoder, with its parameters; None where the model uses none.
        context: The context in which the model is built.
        files: sha256 of every file that the model saved, by name.
        identity: Everything that determined the weights, as in the cache.
        report: Report of the training.
        presses: Number of presses that the model learned from.
        trained_on: Sensor and regime in words.
        license: License, as the exporter states it.
    """

    schema_: Literal["tactibench-weights/2"] = Field(alias="schema")
    made_with: str
    model: ComponentValues
    encoder: ComponentValues | None
    context: BuildContext
    files: dict[FileName, str]
    identity: dict[str, Any]
    report: dict[str, Any]
    presses: int
    trained_on: str
    license: str

    @property
    def hash(self) -> str:
        """Return the hash of the weights, as records hold it."""
        return weights_hash(self.files)


def export_weights(
    plan: RunPlan, path: Path, *, license_text: str = "not stated"
) -> WeightsDescription:
    """Write the cached weights of a plan as one file, and return its description.

    Args:
        plan: The plan of a run with these weights.
        path: The file that is written.
        license_text: License of the weights.

    Raises:
        UserError: The weights are not in the cache or are damaged, or a file has a name that a
            weights file cannot hold.
    """
    manifest = plan.weights.read()
    if manifest is None:
        raise no_weights(plan)
    context, components = plan.context(), plan.components
    values = {
        "schema": "tactibench-weights/2",
        "made_with": __version__,
        "model": components.model.component.identity,
        "encoder": components.encoder and components.encoder.component.identity,
        "context": {
            "answer": context.answer,
            "cells": context.grid.shape,
            "origin_mm": context.grid.origin,
            "pitch_mm": context.grid.pitch,
            "max_depth_mm": context.max_depth,
            "transfers": context.transfers,
        },
        "files": manifest["files"],
        "identity": plan.weights.identity,
        "report": manifest["report"],
        "presses": manifest["presses"],
        "trained_on": f"{components.sensor.label}, regime {components.regime} of {plan.spec.id}",
        "license": license_text,
    }
    with _refused(f"the weights of {components.model.label}"):
        description = WeightsDescription.model_validate(values)
    text = json.dumps(values, indent=1, sort_keys=True, allow_nan=False)
    with atomic(path) as stream, zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr(zipfile.ZipInfo(DESCRIPTION, FIRST_DAY), text)
        for name in sorted(description.files):
            content = (plan.weights.folder / name).read_bytes()
            archive.writestr(zipfile.ZipInfo(FOLDER + name, FIRST_DAY), content)
    return description


def read_description(path: Path) -> WeightsDescription:
    """Return the description in a weights file.

    Raises:
        UserError: The file does not exist, is no weights file or is damaged.
    """
    if not path.is_file():
        raise UserError(f"{path} is not there; name a file of `tactibench weights export`.")
    with _refused(str(path)), zipfile.ZipFile(path) as archive:
        return WeightsDescription.model_validate(parse_json(archive.read(DESCRIPTION).decode()))


def open_weights(path: Path, *, device: str = "auto") -> tuple[Model, str]:
    """Return the model of a weights file, ready to answer frames, and its label.

    Args:
        path: A file of ``tactibench weights export``. The hash of every file in it is compared
            before the model reads one.
        device: "auto", "cpu" or "cuda".

    Raises:
        UserError: The file is damaged, or this installation has no such model.
    """
    description, host = read_description(path), PluginHost()
    context, encoder = description.context, description.encoder
    model: Model = description.model.bound(host.models.for_answer(context.answer)).build(
        ModelContext(
            answer=context.answer,
            grid=Grid(context.cells, context.origin_mm, context.pitch_mm),
            max_depth=context.max_depth_mm,
            encoder=None if encoder is None else encoder.bound(host.encoders).build(),
            device=choose_device(device),
            transfers=context.transfers,
        )
    )
    with TemporaryDirectory(prefix="tactibench-weights-") as place:
        folder = Path(place)
        with _refused(str(path)), zipfile.ZipFile(path) as archive:
            for name, sha256 in description.files.items():
                entry = archive.getinfo(FOLDER + name)
                if entry.compress_type != zipfile.ZIP_STORED:  # a small file may fill the disk
                    raise ValueError("its files are compressed, which export never does")
                content = archive.read(entry)
                if hashlib.sha256(content).hexdigest() != sha256:
                    raise ValueError(f"the sha256 of {name} does not fit")
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                (folder / name).write_bytes(content)
        model.load(folder)
    return model, f"{description.model.name} ({description.hash[:8]})"


@contextmanager
def _refused(what: str) -> Iterator[None]:
    """Turn whatever is wrong with a weights file into a sentence about it."""
    try:
        yield
    except ValidationError as error:
        why = first_mistake(error, WeightsDescription).rstrip(".")
    except (zipfile.BadZipFile, OSError, EOFError, KeyError, ValueError, RuntimeError) as error:
        why = str(error)  # NotImplementedError and RecursionError are RuntimeErrors
    else:
        return
    raise UserError(f"{what} holds no usable weights: {why}; get it again or export it again.")


class OnnxCheck(NamedTuple):
    """The differences between an ONNX file and its model.

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

    inputs, network = model.inputs(frames), model.fold(model.network).cpu()
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
    if isinstance(one, Sites) and isinstance(other, Sites):
        return float(np.abs(np.subtract(one.probability, other.probability)).max(initial=0.0))
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
