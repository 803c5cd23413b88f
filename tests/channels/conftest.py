"""A simulated skin, written from the template that `tactibench new sensor --channels` gives."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import pytest

from tactibench import Indenter, Pose, Scene, SensorContext
from tactibench.geometry import true_contacts
from tactibench.scaffold import Names, write_package


@pytest.fixture(scope="session")
def skin(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return the class of a sensor of 15 channels."""
    folder = write_package(Names("sensor", "soft_skin"), tmp_path_factory.mktemp("new"), "skin")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        return importlib.import_module("tactibench_soft_skin.sensor").SoftSkin


@pytest.fixture(scope="session")
def press_skin(skin: Any) -> Any:
    """Return a function: count, seed -> frames and truth of single presses in the skin's range."""

    def press(count: int, seed: int, **parameters: float) -> tuple[list[Any], list[Any]]:
        rng = np.random.default_rng(seed)
        space = skin.workspace
        places = rng.uniform(-space.half_width_mm, space.half_width_mm, (count, 2))
        depths = rng.uniform(space.depth_min_mm, space.depth_max_mm, count)
        scenes = [
            Scene(Indenter.single(), Pose(float(x), float(y), depth=float(depth)))
            for (x, y), depth in zip(places, depths, strict=True)
        ]
        with skin(SensorContext(np.random.SeedSequence(seed)), **parameters) as sensor:
            frames = list(sensor.press_many(scenes))
        return frames, [true_contacts(scene, space.dome_radius_mm) for scene in scenes]

    return press
