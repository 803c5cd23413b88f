"""The field that channels of a skin follow, and its inversion in ``pins``."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
import torch

from tactibench.superposition import matern
from tactibench_pins import ForwardModel, Inversion

Array = npt.NDArray[np.float64]


def skin(targets: Array) -> Array:
    """Return four smooth channels of x, y, depth."""
    x, y, depth = targets.T
    return np.stack([np.exp(depth / 2) * f(v) for v in (x, y) for f in (np.sin, np.cos)], axis=1)


def draw(count: int, seed: int) -> Array:
    """Return three presses at each of ``count`` places."""
    rng = np.random.default_rng(seed)
    places = np.repeat(rng.uniform(-1.7, 1.7, (count, 2)), 3, axis=0)
    return np.column_stack([places, rng.uniform(-1.7, 1.7, 3 * count)])


@pytest.fixture(scope="module")
def forward() -> ForwardModel:
    targets = draw(100, 1)
    noise = np.random.default_rng(2).normal(0, [0.001, 0.01, 0.1, 0.001], (300, 4))
    return ForwardModel.fit(targets, skin(targets) + noise)


def test_a_field_is_known_between_its_presses(forward: ForwardModel) -> None:
    targets = draw(50, 3)
    missed = (forward(targets) - skin(targets)).std(axis=0)
    assert missed[[0, 1, 3]].max() < 0.05
    assert missed[2] < 0.1  # less than the noise of this channel


def test_every_channel_has_its_own_noise(forward: ForwardModel) -> None:
    assert forward.noise[2] > 10 * forward.noise[0]


def test_residuals_do_not_know_the_place(forward: ForwardModel) -> None:
    # The same process without the first place, solved outright.
    others, own = forward.targets[3:], forward.targets[:3]
    centred = (matern(forward.targets, forward.targets, 1.0) + np.eye(300) * forward.noise[0]) @ (
        forward.alpha[:, :1]
    )
    gram = matern(others, others, 1.0) + forward.noise[0] * np.eye(297)
    missed = centred[:3] - matern(own, others, 1.0) @ np.linalg.solve(gram, centred[3:])
    assert np.allclose(forward.residuals[:3, :1], missed, atol=1e-6)


def test_the_inversion_finds_what_was_pressed(forward: ForwardModel) -> None:
    network = Inversion(4, [0, 1, 3], 4)
    network.tabulate(forward, 0.03)
    targets = draw(60, 4)
    moved = torch.from_numpy(skin(targets)).float()
    with torch.inference_mode():
        answers = network(moved)[:, 0].numpy()
        alone = torch.cat([network(row[None]) for row in moved])[:, 0].numpy()
    assert np.allclose(answers, alone, atol=1e-4)
    assert not answers[:, 2].any()  # a target that never varied
    error = np.abs(answers[:, [0, 1, 3]] - targets).mean(axis=0)
    assert error.max() < 0.05  # targets have a deviation of 1
