"""Presses of a sensor of channels, moved to other places for the training of ``pins``."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from tactibench.superposition import matern
from tactibench_pins import COPIES, ForwardModel, move_presses

Array = npt.NDArray[np.float64]


def skin(targets: Array) -> Array:
    """Return four smooth channels of x, y, depth."""
    x, y, depth = targets.T
    return np.stack([np.exp(depth / 2) * f(v) for v in (x, y) for f in (np.sin, np.cos)], axis=1)


@pytest.fixture(scope="module")
def targets() -> Array:
    """Return three presses at each of 100 places."""
    rng = np.random.default_rng(1)
    places = np.repeat(rng.uniform(-1.7, 1.7, (100, 2)), 3, axis=0)
    return np.column_stack([places, rng.uniform(-1.7, 1.7, 300)])


def test_moved_presses_have_the_channels_of_their_new_place(targets: Array) -> None:
    there, moved = move_presses(targets, skin(targets), np.random.default_rng(2))
    assert there.shape == (COPIES * 300, 3)
    assert moved.shape == (COPIES * 300, 4)
    assert np.median(np.abs(there - np.tile(targets, (COPIES, 1)))) > 0.1
    assert np.all(there >= targets.min(axis=0))
    assert np.all(there <= targets.max(axis=0))
    spread = skin(targets).std()
    assert np.median(np.abs(moved - skin(there))) < 0.02 * spread


def test_errors_of_presses_move_with_them(targets: Array) -> None:
    rng = np.random.default_rng(3)
    # All channels are off together, as where the whole skin yielded more.
    errors = 0.1 * rng.standard_normal((300, 1)) * np.ones(4)
    there, moved = move_presses(targets, skin(targets) + errors, rng)
    off = moved - skin(there)
    assert np.corrcoef(off.T).min() > 0.8
    assert 0.08 < off.std() < 0.16


def test_residuals_do_not_know_the_place(targets: Array) -> None:
    channels = skin(targets)
    places = np.repeat(np.arange(100), 3)
    forward = ForwardModel.fit(targets, channels, places)
    # The same process without the first place, solved outright.
    noise = _noise(forward, channels)
    others, own = forward.targets[3:], forward.targets[:3]
    gram = matern(others, others, 1.0) + noise * np.eye(297)
    alpha = np.linalg.solve(gram, channels[3:] - forward.mean)
    missed = channels[:3] - forward.mean - matern(own, others, 1.0) @ alpha
    assert np.allclose(forward.residuals[:3], missed, atol=1e-6)


def _noise(forward: ForwardModel, channels: Array) -> float:
    """Return the noise of a process: what it leaves of a press is noise times its weight."""
    left = channels - forward(forward.targets * forward.lengths)
    return float(np.median(left / forward.alpha))
