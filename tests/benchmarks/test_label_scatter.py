"""``benchmarks/label_scatter.py`` finds the scatter that labels were given."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import numpy as np
import numpy.typing as npt
import pytest

PRESSES, PINS = 1200, 30
DEPTH_MM, TILT_DEG, SLOPE = 0.02, 0.15, 0.02


@pytest.fixture(scope="module")
def module(load_benchmark: Callable[[str], ModuleType]) -> ModuleType:
    return load_benchmark("label_scatter")


def recording(
    share: float, rng: np.random.Generator
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """Displacements, labels, and which presses were not moved; labels scatter as above."""
    depth, tilt, side, turn = rng.uniform(-1, 1, (4, PRESSES)) * [[2], [20], [5], [5]]
    still = rng.uniform(size=PRESSES) < share
    state = np.column_stack([depth / 2, tilt / 20, ~still * side / 5, ~still * turn / 25])
    angles = state @ rng.normal(0, 0.5, (4, 2 * PINS)) + rng.uniform(0, 6, 2 * PINS)
    moved = 10 * np.sin(angles) + rng.normal(0, 0.01, (PRESSES, 2 * PINS))
    depth = depth + still * SLOPE * side + rng.normal(0, DEPTH_MM, PRESSES)
    tilt = tilt + still * turn + rng.normal(0, TILT_DEG, PRESSES)
    return moved, np.column_stack([depth, tilt, side, turn]), still


@pytest.mark.long
def test_scatter_and_moves_that_were_not_made_are_found(module: ModuleType) -> None:
    rng = np.random.default_rng(1)
    moved, labels, still = recording(0.3, rng)
    found = module.scatter(moved, labels, rng)
    figures = module.intervals(found.figures, PRESSES, rng)
    assert np.mean(found.unmade[found.turned] == still[found.turned]) > 0.99
    off = np.abs(labels[:, 2:] * [SLOPE, 1.0] * still[:, np.newaxis]).mean(axis=0)
    np.testing.assert_allclose(figures["move"][0], off, rtol=0.1)
    rest = np.sqrt(2 / np.pi) * np.array([DEPTH_MM, TILT_DEG])
    np.testing.assert_allclose(figures["equal frames"][0], rest, rtol=0.2)
    assert (figures["held out"][0] > 0.95 * rest).all()
    assert (found.pins < figures["equal frames"][0]).all()
    assert (figures["move"][0] < figures["labels at least"][0]).all()
    assert (figures["labels at least"][0] < figures["at most"][0]).all()
    for value, low, high in figures.values():
        assert (low <= value).all()
        assert (value <= high).all()


def test_the_slope_is_that_of_least_absolute_residuals(module: ModuleType) -> None:
    x = np.array([-2.0, -1.0, 1.0, 2.0, 3.0])
    assert module.median_slope(x, 0.5 * x + [0, 0, 0, 0, 9]) == 0.5
