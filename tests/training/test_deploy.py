"""Every configuration gives the outputs of the network."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import pytest
import torch
from torch import nn

from tactibench.training import (
    CONFIGURATIONS,
    UnavailableError,
    deploy,
    fold_batch_norm,
    prepare_forward,
)


class Small(nn.Module):
    """(B, 1, 8, 8) uint8 -> (B, 2)."""

    def __init__(self) -> None:
        super().__init__()
        self.body = nn.Sequential(nn.Conv2d(1, 4, 3, padding=1), nn.BatchNorm2d(4), nn.ReLU())
        self.head = nn.Linear(4 * 64, 2)

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        return self.head(self.body(images.float() / 255).flatten(1))


@pytest.fixture
def network() -> nn.Module:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(3)
        made = Small()
        nn.init.normal_(made.body[1].running_mean)
        nn.init.uniform_(made.body[1].running_var, 0.5, 2)
    return made.eval()


@pytest.fixture
def images() -> torch.Tensor:
    return torch.arange(5 * 64, dtype=torch.uint8).reshape(5, 1, 8, 8)


@pytest.mark.parametrize("name", ["float32", "folded", "frozen"])
@pytest.mark.parametrize("count", [1, 5])
def test_float32_ways_agree(network, images, name, count):
    forward = prepare_forward(name, network, fold_batch_norm, images[:1], "cpu")
    with torch.no_grad():
        wanted = network(images[:count])
    for _ in range(3):  # a graph specialises itself in its first calls
        found = forward(images[:count])
        assert found.dtype == torch.float32
        torch.testing.assert_close(found.clone(), wanted, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("name", ["bf16", "bf16-frozen"])
def test_bf16_ways_are_near_and_only_where_native(network, images, monkeypatch, name):
    monkeypatch.setattr(deploy, "resolve_precision", lambda *_: "float32")
    with pytest.raises(UnavailableError, match="bf16 natively"):
        prepare_forward(name, network, fold_batch_norm, images[:1], "cpu")
    monkeypatch.setattr(deploy, "resolve_precision", lambda *_: "bf16")
    forward = prepare_forward(name, network, fold_batch_norm, images[:1], "cpu")
    with torch.no_grad():
        wanted = network(images)
    found = forward(images)
    assert found.dtype == torch.float32
    torch.testing.assert_close(found.clone(), wanted, rtol=0.03, atol=0.03)
    assert not torch.equal(found, wanted)


def test_the_network_itself_stays_as_it_was(network, images):
    before = {name: value.clone() for name, value in network.state_dict().items()}
    for name in ("float32", "folded", "frozen"):
        prepare_forward(name, network, fold_batch_norm, images[:1], "cpu")(images)
    for key, value in network.state_dict().items():
        assert torch.equal(value, before[key])


class Counting(nn.Module):
    """Its outputs depend on how many frames the tracer saw."""

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        return images.float().mean((1, 2, 3)) * len(images.tolist())


def test_a_graph_that_depends_on_the_batch_is_refused(images):
    with pytest.raises(UnavailableError, match=r"graph does not|cannot be traced"):
        prepare_forward("frozen", Counting(), lambda network, _: network, images[:1], "cpu")


class Untraceable(nn.Module):
    def forward(self, images: torch.Tensor) -> torch.Tensor:
        raise RuntimeError("no way\nat all")


def test_a_tracer_that_fails_gives_its_first_line(images):
    with pytest.raises(UnavailableError, match=r"cannot be traced: RuntimeError: no way$"):
        prepare_forward("frozen", Untraceable(), lambda network, _: network, images[:1], "cpu")


def test_a_compiler_that_fails_is_a_reason(network, images, monkeypatch):
    def fail(*_, **__):
        raise RuntimeError("no C++ compiler")

    monkeypatch.setattr(torch, "compile", fail)
    with pytest.raises(UnavailableError, match=r"torch\.compile failed: RuntimeError: no C\+\+"):
        prepare_forward("compiled", network, fold_batch_norm, images[:1], "cpu")


@pytest.mark.parametrize(
    ("computed", "reason"),
    [
        (lambda _: _no_compiler(), "does not run on 1 frames"),
        (lambda x: x[:, 0] * 0 + 9, "outputs"),
    ],
)
def test_a_compiled_network_is_compared_with_the_network(
    network, images, monkeypatch, computed, reason
):
    monkeypatch.setattr(torch, "compile", lambda *_, **__: computed)
    with pytest.raises(UnavailableError, match=reason):
        prepare_forward("compiled", network, fold_batch_norm, images[:1], "cpu")


def _no_compiler():
    raise RuntimeError("no C++ compiler")


def test_what_torch_compile_gives_is_called_outside_of_inference_mode(network, images, monkeypatch):
    modes = []

    def compile_(module, **_):
        def run(inputs):
            modes.append((torch.is_inference_mode_enabled(), torch.is_grad_enabled()))
            return module(inputs)

        return run

    monkeypatch.setattr(torch, "compile", compile_)
    forward = prepare_forward("compiled", network, fold_batch_norm, images[:1], "cpu")
    assert forward(images).shape == (5, 2)
    assert set(modes) == {(False, False)}


def test_onnx_runtime_is_an_extra(network, images, monkeypatch):
    monkeypatch.setattr(deploy, "find_spec", lambda _: None)
    with pytest.raises(UnavailableError, match=r'pip install "tactibench\[onnx\]"'):
        prepare_forward("onnxruntime", network, fold_batch_norm, images[:1], "cpu")
    with pytest.raises(UnavailableError, match="CPU only"):
        prepare_forward("onnxruntime", network, fold_batch_norm, images[:1], "cuda")


def test_a_session_is_made_for_every_thread_count(network, images, monkeypatch):
    """A stand-in for ONNX Runtime that computes with the network."""
    made = []

    class Session:
        def __init__(self, model, options, providers):
            made.append((model, options.intra_op_num_threads, tuple(providers)))

        def run(self, outputs, inputs):
            with torch.no_grad():
                return [network(torch.from_numpy(inputs["inputs"])).numpy()]

    fake = SimpleNamespace(InferenceSession=Session, SessionOptions=SimpleNamespace)
    monkeypatch.setitem(sys.modules, "onnxruntime", fake)
    monkeypatch.setattr(deploy, "find_spec", lambda _: True)
    monkeypatch.setattr(deploy, "onnx_model", lambda *_: b"model")
    forward = prepare_forward("onnxruntime", network, fold_batch_norm, images[:1], "cpu")
    with torch.no_grad():
        torch.testing.assert_close(forward(images).clone(), network(images))
    assert made == [(b"model", torch.get_num_threads(), ("CPUExecutionProvider",))]


def test_the_real_onnx_runtime(network, images):
    pytest.importorskip("onnx", reason='needs "tactibench[onnx]"')
    pytest.importorskip("onnxruntime", reason='needs "tactibench[onnx]"')
    forward = prepare_forward("onnxruntime", network, fold_batch_norm, images[:1], "cpu")
    with torch.no_grad():
        torch.testing.assert_close(forward(images).clone(), network(images), rtol=1e-4, atol=1e-5)


def test_an_unknown_name(network, images):
    assert "other" not in CONFIGURATIONS
    with pytest.raises(KeyError):
        prepare_forward("other", network, fold_batch_norm, images[:1], "cpu")
