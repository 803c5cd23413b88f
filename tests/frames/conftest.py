"""A sensor that needs no mechanics, and frames with a known number of drawn pins.

The sensor's frames are noise of its seed and the press's number.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from tactibench import Frame, Grid, Indenter, Pose, Scene, Sensor, SensorContext
from tactibench.frames import GeneratedFrameSet
from tactibench.frames import cache as generated

SHAPE = (6, 5)


@dataclass
class Counter:
    """How often sensors were opened and pressed, and when one is to fail."""

    presses: int = 0
    surfaces: int = 0
    fail_at: int | None = None
    error: type[BaseException] = RuntimeError


@dataclass
class NoiseSensor(Sensor):
    context: SensorContext
    counter: Counter
    offset: float = 0.0
    done: int = field(default=0, init=False)

    def __enter__(self) -> NoiseSensor:
        self.done = 0
        return self

    def rest(self) -> Frame:
        return Frame(np.zeros(SHAPE, np.uint8), 0.0, Pose())

    def press(self, scene: Scene) -> Frame:
        if self.counter.fail_at == self.counter.presses:
            raise self.counter.error
        seed = self.context.seed
        own = np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, self.done))
        image = np.random.default_rng(own).integers(0, 256, SHAPE, dtype=np.uint8)
        self.done += 1
        self.counter.presses += 1
        pose = replace(scene.pose, x=scene.pose.x + self.offset)
        return Frame(image, float(self.done), pose)

    def describe(self) -> dict[str, Any]:
        return {"offset": self.offset}

    def surface(self, scene: Scene, grid: Grid) -> np.ndarray:
        self.counter.surfaces += 1
        return np.full(grid.shape, scene.pose.depth)

    def bound(self, scene: Scene) -> np.ndarray:
        self.counter.surfaces += 1
        return np.full((len(scene.indenter.offsets), 3), scene.pose.depth)


def scenes(count: int) -> tuple[Scene, ...]:
    kinds = (Indenter.single(), Indenter.dual(7.0))
    return tuple(Scene(kinds[i % 2], Pose(x=0.01 * i, depth=1.0 + 0.01 * i)) for i in range(count))


@pytest.fixture(autouse=True)
def _small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generated, "CHUNK", 7)


@pytest.fixture
def counter() -> Counter:
    return Counter()


@pytest.fixture
def request_of(counter: Counter) -> Callable[..., GeneratedFrameSet]:
    def build(count: int = 25, *, offset: float = 0.0, **changes: Any) -> GeneratedFrameSet:
        keys: dict[str, Any] = {
            "role": "fit",
            "name": "some",
            "groups": ("all",) * count,
            "cache": Path("cache"),
            "build": lambda context: NoiseSensor(context, counter, offset),
            "identity": {"name": "noise", "offset": offset},
            "scenes": scenes(count),
            "names": tuple(f"some-{3 * i}" for i in range(count)),
            "seed": (5, 1, 0),
        }
        return GeneratedFrameSet(**{**keys, **changes})

    return build


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
