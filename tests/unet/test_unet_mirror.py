"""The U-Net sees flip_maps frames where, and only where, that is true of the sensor."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from tactibench import Frame, Grid, ModelContext, Pose
from tactibench_heatmaps import HertzGaussian, Offsets
from tactibench_unet import UNet, UNetNetwork

GRID = Grid.centred(32, 0.8)


def symmetric_frames() -> list[Frame]:
    rest = np.zeros((64, 64), np.uint8)
    rest[20:24, 20:24] = rest[20:24, 40:44] = rest[40:44, 20:24] = rest[40:44, 40:44] = 200
    return [Frame(rest, 0.0, Pose(), rest)]


@pytest.mark.parametrize(
    ("encoder", "options", "wanted"),
    [
        (HertzGaussian(), {}, (True, True)),
        (HertzGaussian(), {"mirror": "never"}, (False, False)),
        (HertzGaussian(), {"recipe": "paper"}, (False, False)),
        (HertzGaussian(), {"recipe": "paper", "mirror": "auto"}, (True, True)),
        (Offsets(), {}, (False, False)),  # its maps hold steps, which change sign
    ],
)
def test_mirrors_where_sensor_encoder_and_recipe_allow(encoder, options, wanted) -> None:
    model = UNet(ModelContext("contacts", GRID, 6.0, encoder=encoder), size=64, **options)
    model.prepare(symmetric_frames(), [])
    assert model.build().mirror == wanted


def test_a_lopsided_sensor_or_one_without_a_rest_frame_is_not_mirrored() -> None:
    model = UNet(ModelContext("contacts", GRID, 6.0, encoder=HertzGaussian()), size=64)
    lopsided = symmetric_frames()[0].rest.copy()
    lopsided[20:24, 20:24] = 0
    model.prepare([Frame(lopsided, 0.0, Pose(), lopsided)], [])
    assert model.build().mirror == (False, False)
    model.prepare([Frame(lopsided, 0.0, Pose(), None)], [])
    assert model.build().mirror == (False, False)


def test_outputs_of_mirrored_frames_are_turned_back() -> None:
    """In training an output is that of the frame or of a mirrored one; then a mean of two."""
    with torch.random.fork_rng():
        torch.default_generator.manual_seed(3)
        network = UNetNetwork(8, 2, (16, 16), 1, mirror=(True, True))
        frames = torch.randint(0, 255, (1, 1, 32, 32), dtype=torch.uint8)
        network.eval()
        possible = [
            network._logits(frames.flip(axes)).flip(axes) for axes in ((), (-1,), (-2,), (-1, -2))
        ]
        answered = network(frames)
        assert torch.allclose(answered, (possible[0] + possible[3]) / 2, atol=1e-6)
        network.train()
        for module in network.modules():
            if isinstance(module, torch.nn.BatchNorm2d):
                module.eval()
        seen: set[int] = set()
        for _ in range(40):
            found = network(frames)
            seen |= {k for k, one in enumerate(possible) if torch.allclose(found, one, atol=1e-6)}
    assert seen == {0, 1, 2, 3}
