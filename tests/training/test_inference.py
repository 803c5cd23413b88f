"""Arithmetic of a network, and its copy for inference."""

import pytest
import torch
from state_hash import state_hash
from torch import nn

from tactibench.training import autocast, fold_batch_norm, processor_flags, resolve_precision


def test_a_folded_network_answers_as_before():
    network = nn.Sequential(
        nn.Sequential(nn.Conv2d(1, 3, 3, bias=False), nn.BatchNorm2d(3), nn.ReLU(inplace=True)),
        nn.Conv2d(3, 2, 1),
        nn.BatchNorm2d(2),
    )
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            nn.init.uniform_(module.running_mean, -1, 1)
            nn.init.uniform_(module.running_var, 0.2, 2)
            nn.init.uniform_(module.weight, -1, 1)
            nn.init.uniform_(module.bias, -1, 1)
    before = state_hash(network)
    folded = fold_batch_norm(network)
    images = torch.rand(4, 1, 9, 9)
    with torch.inference_mode():
        expected = network.eval()(images)
        torch.testing.assert_close(folded(images), expected, rtol=1e-5, atol=1e-6)
    assert not any(isinstance(module, nn.BatchNorm2d) for module in folded.modules())
    assert state_hash(network) == before


def test_a_copy_stored_in_bf16_answers_like_autocast():
    network = nn.Sequential(
        nn.Conv2d(1, 3, 3), nn.BatchNorm2d(3), nn.ReLU(), nn.Flatten(), nn.Linear(147, 2)
    )
    images = torch.rand(4, 1, 9, 9)
    with torch.inference_mode(), autocast("bf16", "cpu"):
        expected = fold_batch_norm(network)(images)
        assert torch.equal(fold_batch_norm(network, "bf16")(images), expected)


def test_precision_is_taken_as_given_and_auto_is_one_of_both():
    assert resolve_precision("float32", "cpu") == "float32"
    assert resolve_precision("bf16", "cpu") == "bf16"
    assert resolve_precision("auto", "cpu") in ("float32", "bf16")
    layer = nn.Linear(2, 2)
    for precision, dtype in (("float32", torch.float32), ("bf16", torch.bfloat16)):
        with autocast(precision, "cpu"):
            assert layer(torch.zeros(1, 2)).dtype == dtype


@pytest.mark.parametrize(
    ("flags", "chosen"),
    [("fpu avx512f avx512_bf16", "bf16"), ("fpu amx_bf16", "bf16"), ("fpu avx512f", "float32")],
)
def test_auto_follows_the_processors_flags(monkeypatch, tmp_path, flags, chosen):
    file = tmp_path / "cpuinfo"
    file.write_text(f"processor : 0\nflags\t\t: {flags}\n\nprocessor : 1\nflags : other\n")
    found = processor_flags(file)
    assert found == set(flags.split())
    monkeypatch.setattr("tactibench.training.precision.processor_flags", lambda: found)
    assert resolve_precision("auto", "cpu") == chosen


def test_a_machine_that_does_not_tell_its_flags_trains_in_float32(tmp_path):
    assert processor_flags(tmp_path / "missing") == frozenset()
