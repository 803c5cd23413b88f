"""Arithmetic of a network, and its copy for inference."""

import torch
from state_hash import state_hash
from torch import nn

from tactibench.training import autocast, float32_tensors, fold_batch_norm


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


def test_autocast_computes_in_the_precision_that_is_asked_for():
    layer = nn.Linear(2, 2)
    for precision, dtype in (("float32", torch.float32), ("bf16", torch.bfloat16)):
        with autocast(precision, "cpu"):
            assert layer(torch.zeros(1, 2)).dtype == dtype


def test_new_tensors_are_float32_whatever_the_callers_default_is():
    torch.set_default_dtype(torch.float64)
    try:
        with float32_tensors():
            assert torch.zeros(1).dtype == torch.float32
        assert torch.zeros(1).dtype == torch.float64
    finally:
        torch.set_default_dtype(torch.float32)
