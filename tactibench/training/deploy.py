"""Configurations in which one network can compute its outputs, to be timed against each other.

A forward pass takes a model's ``inputs`` and returns raw float32 outputs. The frozen graph is
TorchScript: it needs no compiler where it runs and saves the time of Python between the layers,
which matters in a network that computes one frame in a few milliseconds.
"""

from __future__ import annotations

import copy
import io
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any

import torch
from torch import nn

from tactibench.training.inference import autocast, deterministic_kernels
from tactibench.training.precision import resolve_precision

Forward = Callable[[torch.Tensor], torch.Tensor]
Fold = Callable[[nn.Module, str], nn.Module]

_TOLERANCE = 1e-3
"""Largest difference from the folded network, as a share of the largest output."""
_TOLERANCE_BF16 = 2e-2
"""The same where outputs are bf16, whose numbers have 8 bits of precision."""


class UnavailableError(Exception):
    """A configuration that this machine or network cannot compute; the message tells why."""


def prepare_forward(
    name: str, network: nn.Module, fold: Fold, example: torch.Tensor, device: str
) -> Forward:
    """Return the forward pass of a configuration, prepared for any number of frames.

    Args:
        name: A name in CONFIGURATIONS.
        network: A trained network in evaluation mode, on the device.
        fold: fold(network, precision), which returns a copy for inference.
        example: (N, ...) inputs.
        device: "cpu" or "cuda".

    Raises:
        UnavailableError: This machine or the network cannot compute the configuration.
        KeyError: The name is not in CONFIGURATIONS.
    """
    make: dict[str, Callable[[], Forward]] = {
        "float32": lambda: network,
        "folded": lambda: fold(network, "float32"),
        "frozen": lambda: _frozen(fold(network, "float32"), example.to(device)),
        "bf16": lambda: _bf16(network, fold, device),
        "bf16-frozen": lambda: _frozen_bf16(_bf16(network, fold, device), example, device),
        "compiled": lambda: _compiled(fold(network, "float32"), example.to(device)),
        "onnxruntime": lambda: _onnx(fold(network, "float32"), example, device),
    }
    with torch.no_grad():
        compute = make[name]()
    precision = "bf16" if name == "bf16" else "float32"  # a frozen graph holds its own casts
    # Inside inference mode inductor would compile again what it has compiled outside of it.
    mode = torch.no_grad if name == "compiled" else torch.inference_mode

    def forward(inputs: torch.Tensor) -> torch.Tensor:
        with mode(), deterministic_kernels(device, precision), autocast(precision, device):
            return compute(inputs.to(device)).float()

    return forward


def _bf16(network: nn.Module, fold: Fold, device: str) -> nn.Module:
    if resolve_precision("auto", device) != "bf16":
        raise UnavailableError("this machine does not compute bf16 natively, emulated it is slower")
    return fold(network, "bf16")


def _frozen(network: nn.Module, example: torch.Tensor) -> Forward:
    """Trace the network with its weights as constants.

    Raises:
        UnavailableError: It cannot be traced, or the graph does not give its outputs.
    """
    with _without_warnings():
        try:
            trace: Any = torch.jit.trace
            graph: Any = torch.jit.freeze(trace(network, example, check_trace=False))
        except Exception as error:
            raise UnavailableError(f"its network cannot be traced: {_first_line(error)}") from error
        _check(graph, network, example)
    return graph  # type: ignore[no-any-return]


def _frozen_bf16(network: nn.Module, example: torch.Tensor, device: str) -> Forward:
    """Make the casts of autocast part of the graph, so that they are not looked up in each call."""
    with torch.autocast(device, dtype=torch.bfloat16, cache_enabled=False):
        return _frozen(network, example.to(device))


def _compiled(network: nn.Module, example: torch.Tensor) -> Forward:
    """Compile the network; a missing compiler is found in the first call, which ``_check`` makes.

    Raises:
        UnavailableError: It cannot be compiled, or does not give the outputs of the network.
    """
    with _without_warnings(), torch.no_grad():
        try:
            compiled: Any = torch.compile(network, dynamic=False)
        except Exception as error:
            raise UnavailableError(f"torch.compile failed: {_first_line(error)}") from error
        _check(compiled, network, example)
    return compiled  # type: ignore[no-any-return]


def _onnx(network: nn.Module, example: torch.Tensor, device: str) -> Forward:
    """Compute in ONNX Runtime, with as many threads as torch has at the time of the call.

    Raises:
        UnavailableError: The device is no CPU, ONNX Runtime is not installed, or the network cannot
            be exported or does not give its outputs.
    """
    if device != "cpu":
        raise UnavailableError("it is measured on a CPU only")
    if not (find_spec("onnx") and find_spec("onnxruntime")):
        raise UnavailableError('ONNX Runtime is not installed; pip install "tactibench[onnx]"')
    import onnxruntime

    try:
        model = onnx_model(network, example)
    except Exception as error:
        raise UnavailableError(f"its network cannot be exported: {_first_line(error)}") from error
    sessions: dict[int, Any] = {}

    def run(inputs: torch.Tensor) -> torch.Tensor:
        threads = torch.get_num_threads()
        if threads not in sessions:
            options = onnxruntime.SessionOptions()
            options.intra_op_num_threads = threads
            sessions[threads] = onnxruntime.InferenceSession(
                model, options, providers=["CPUExecutionProvider"]
            )
        return torch.from_numpy(sessions[threads].run(None, {"inputs": inputs.numpy()})[0])

    _check(run, network, example)
    return run


def onnx_model(network: nn.Module, example: torch.Tensor) -> bytes:
    """Return a network as an ONNX model with a free number of frames.

    Args:
        network: A network in evaluation mode, on the CPU, from "inputs" to "outputs".
        example: (N, ...) inputs.
    """
    plain = copy.deepcopy(network)
    for tensor in (*plain.parameters(), *plain.buffers()):
        tensor.data = tensor.data.contiguous()
    file = io.BytesIO()
    export: Any = torch.onnx.export  # its type does not know that it writes to memory, too
    with _without_warnings(), torch.no_grad():
        export(
            plain,
            (example,),
            file,
            dynamo=False,
            input_names=["inputs"],
            output_names=["outputs"],
            dynamic_axes={"inputs": {0: "frames"}, "outputs": {0: "frames"}},
        )
    return file.getvalue()


def _check(forward: Forward, network: nn.Module, example: torch.Tensor) -> None:
    """Compare a forward pass with the network itself, on one frame and on a batch of three.

    Raises:
        UnavailableError: The pass fails, or its outputs differ from those of the network.
    """
    for inputs in (example[:1], example[:1].repeat(3, *(1 for _ in example.shape[1:]))):
        wanted = network(inputs)
        tolerance = _TOLERANCE if wanted.dtype == torch.float32 else _TOLERANCE_BF16
        try:
            outputs = forward(inputs)
        except Exception as error:
            raise UnavailableError(
                f"its graph does not run on {len(inputs)} frames: {_first_line(error)}"
            ) from error
        same = outputs.shape == wanted.shape
        gap = float((outputs.float() - wanted.float()).abs().max()) if same else None
        if gap is None or gap > tolerance * max(1.0, float(wanted.abs().max())):
            raise UnavailableError("its graph does not give the outputs of the network")


@contextmanager
def _without_warnings() -> Iterator[None]:
    """Silence tracers: ``_check`` finds what they warn of."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _first_line(error: Exception) -> str:
    text = str(error).strip().splitlines()
    return f"{type(error).__name__}: {text[0][:200]}" if text else type(error).__name__
