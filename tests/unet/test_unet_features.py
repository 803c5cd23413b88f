"""Every layer of the U-Net, in the order of the forward pass, without a trace in the network."""

from __future__ import annotations

import torch
from drawn_presses import presses

from tactibench_unet import UNetNetwork, layer_features


def test_all_layers_are_shown_with_their_shapes_and_no_hook_stays():
    torch.manual_seed(0)
    network = UNetNetwork(8, 2, (64, 64), 1).eval()
    images = torch.randint(0, 255, (2, 1, 128, 128), dtype=torch.uint8)
    before = network(images)
    found = layer_features(network, images)
    assert list(found) == list(network.layers.values())
    assert {name: values.shape for name, values in found.items()} == {
        "stem": (8, 64, 64),
        "down 1": (8, 64, 64),
        "down 2": (16, 32, 32),
        "down 3": (32, 16, 16),
        "down 4": (64, 8, 8),
        "bottleneck": (128, 4, 4),
        "up 4": (64, 8, 8),
        "up 3": (32, 16, 16),
        "up 2": (16, 32, 32),
        "up 1": (8, 64, 64),
    }
    assert all(values.dtype == "float32" for values in found.values())
    assert all((values >= 0).all() for values in found.values()), "after the ReLU"
    assert not any(module._forward_hooks for module in network.modules())
    assert torch.equal(network(images), before)
    head = network.head(torch.from_numpy(found["up 1"])[None])
    assert torch.allclose(head, before[:1], atol=1e-5)


def test_the_model_shows_them_of_a_frame(make_model):
    model = make_model()
    frame = presses(1, 0)[0][0]
    levels = [f"down {level}" for level in (1, 2, 3)]
    assert list(model.features(frame)) == ["stem", *levels, "bottleneck", "up 3", "up 2", "up 1"]
