"""Configurations in which one network can compute its outputs, to be timed against each other.

A forward pass here takes a model's ``inputs`` and returns raw float32 outputs. The frozen graph is
TorchScript: it needs no compiler where it runs and saves Python's part between the layers, which
counts in a network that computes one frame in some milliseconds.
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
"""Largest difference to the folded network, as a share of the largest output."""
_TOLERANCE_BF16 = 2e-2
"""The same where outputs are numbers of 8 bits."""


class UnavailableError(Exception):
    """A configuration that this machine or network cannot compute; the text says why."""


def prepare_forward(
    name: str, network: nn.Module, fold: Fold, example: torch.Tensor, device: str
) -> Forward:
    """Return the forward pass of a configuration, made ready for any number of frames.

    Args:
        name: one of CONFIGURATIONS.
        network: trained, in evaluation mode, on the device.
        fold: fold(network, precision), a copy for inference.
        example: (N, ...) inputs.
        device: "cpu" or "cuda".

    Raises:
        UnavailableError: with the reason.
        KeyError: for a name that is none of CONFIGURATIONS.
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
    # inductor would compile again inside inference mode what it compiled outside of it.
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
    """Trace the network with weights as constants; refuse a graph that does not give the same."""
    with _without_warnings():
        try:
            trace: Any = torch.jit.trace
            graph: Any = torch.jit.freeze(trace(network, example, check_trace=False))
        except Exception as error:
            raise UnavailableError(f"its network cannot be traced: {_first_line(error)}") from error
        _check(graph, network, example)
    return graph  # type: ignore[no-any-return]


def _frozen_bf16(network: nn.Module, example: torch.Tensor, device: str) -> Forward:
    """Make the casts of autocast part of the graph: they are not looked up in each call."""
    with torch.autocast(device, dtype=torch.bfloat16, cache_enabled=False):
        return _frozen(network, example.to(device))


def _compiled(network: nn.Module, example: torch.Tensor) -> Forward:
    """Compile the network; a missing compiler shows in the first call, that of ``_check``."""
    with _without_warnings(), torch.no_grad():
        try:
            compiled: Any = torch.compile(network, dynamic=False)
        except Exception as error:
            raise UnavailableError(f"torch.compile failed: {_first_line(error)}") from error
        _check(compiled, network, example)
    return compiled  # type: ignore[no-any-return]


def _onnx(network: nn.Module, example: torch.Tensor, device: str) -> Forward:
    """Compute in ONNX Runtime with as many threads as torch has when it is called."""
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
        network: In evaluation mode, on the CPU; takes "inputs" and returns "outputs".
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
    """Compare with the network itself on one frame and on three, as batches differ later."""
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
    """Silence tracers: ``_check`` looks at what they warn of."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _first_line(error: Exception) -> str:
    text = str(error).strip().splitlines()
    return f"{type(error).__name__}: {text[0][:200]}" if text else type(error).__name__
