"""Mirrored frames, and outputs that come back the right way round."""

from __future__ import annotations

import numpy as np
import torch

from tactibench.training import draw_flips, find_symmetry, flip_maps


def test_turning_twice_gives_the_maps_back() -> None:
    maps = torch.rand(4, 2, 5, 7, generator=torch.Generator().manual_seed(0))
    turned = torch.tensor([[False, False], [True, False], [False, True], [True, True]])
    once = flip_maps(maps, turned)
    assert torch.equal(flip_maps(once, turned), maps)
    assert torch.equal(once[0], maps[0])
    assert torch.equal(once[1], maps[1].flip(-1))
    assert torch.equal(once[2], maps[2].flip(-2))
    assert torch.equal(once[3], maps[3].flip(-1, -2))


def test_turns_happen_half_the_time_and_only_where_they_may() -> None:
    with torch.random.fork_rng():
        torch.default_generator.manual_seed(1)
        turned = draw_flips(4000, (True, False), torch.device("cpu"))
    assert turned.shape == (4000, 2)
    assert not turned[:, 1].any()
    assert abs(float(turned[:, 0].float().mean()) - 0.5) < 0.03


def test_a_frame_is_its_own_mirror_image_up_to_noise() -> None:
    rng = np.random.default_rng(0)
    half = rng.integers(0, 200, (16, 8))
    across = np.concatenate([half, half[:, ::-1]], axis=1)
    noisy = (across + rng.normal(0, 1.5, across.shape)).clip(0, 255).astype(np.uint8)
    assert find_symmetry(noisy) == (True, False)
    assert find_symmetry(noisy.T.copy()) == (False, True)
    assert find_symmetry(np.full((9, 9), 7, np.uint8)) == (True, True)
    assert find_symmetry(rng.integers(0, 255, (16, 16)).astype(np.uint8)) == (False, False)
