"""Frames drawn pixel by pixel, with known centres."""

from __future__ import annotations

from collections.abc import Callable

import drawn_pins
import numpy as np
import numpy.typing as npt
import pytest

Array = npt.NDArray[np.float64]
FINE = 8


def draw(centres: Array, radius: float, size: int, *, soft: bool) -> npt.NDArray[np.uint8]:
    """Discs by counting FINE x FINE points in every pixel; not soft: by the pixel's centre."""
    steps = (np.arange(FINE) + 0.5) / FINE - 0.5 if soft else np.zeros(1)
    grid = np.arange(size)[:, None] + steps
    cover = np.zeros((size, size))
    for x, y in centres:
        rows = slice(max(0, int(y - radius) - 2), int(y + radius) + 3)
        columns = slice(max(0, int(x - radius) - 2), int(x + radius) + 3)
        down, right = (grid[rows] - y) ** 2, (grid[columns] - x) ** 2
        inside = down[:, :, None, None] + right[None, None] <= radius**2
        cover[rows, columns] = np.maximum(cover[rows, columns], inside.mean(axis=(1, 3)))
    return np.round(16 + 192 * cover).astype(np.uint8)


@pytest.fixture
def drawn() -> Callable[..., npt.NDArray[np.uint8]]:
    return draw


@pytest.fixture
def hexagon() -> Callable[[float, float], Array]:
    """(61, 2) px in a frame of ``size`` px: pins ``pitch`` px apart, around the middle."""

    return lambda pitch, size: drawn_pins.hexagon(4, pitch, size / 2)


@pytest.fixture
def rings() -> Array:
    """(331, 2) px: ten rings of 6 k pins 11 to 14 px apart in a frame of 360 px."""
    rows = [np.zeros((1, 2))]
    for k in range(1, 11):
        angle = 2 * np.pi * np.arange(6 * k) / (6 * k)
        rows.append((11.4 * k + 0.21 * k**2) * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    return np.concatenate(rows) + 179.5
