"""Frames with a known number of pins, drawn without the simulator."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

PITCH, SIDE = 9, 9


def pins(colours: int = 0) -> npt.NDArray[np.uint8]:
    """(100, 100[, colours]) of 81 bright discs on a dark, noisy ground."""
    rng = np.random.default_rng(5)
    y, x = np.mgrid[:100, :100]
    light = np.zeros((100, 100))
    for row in range(SIDE):
        for column in range(SIDE):
            away = np.hypot(y - (14 + PITCH * row), x - (14 + PITCH * column))
            light = np.maximum(light, np.clip(2.2 - away, 0, 1))
    image = 15 + 165 * light + rng.normal(0, 1.5, light.shape)
    flat = np.rint(np.clip(image, 0, 255)).astype(np.uint8)
    return flat if not colours else np.repeat(flat[..., None], colours, axis=2)


@pytest.fixture
def image() -> npt.NDArray[np.uint8]:
    return pins()


@pytest.fixture
def coloured() -> npt.NDArray[np.uint8]:
    return pins(3)
