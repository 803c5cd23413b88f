"""What a simulator knows beyond the frames, kept beside them: surfaces and bounds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import FloatArray, Grid
from tactibench.datasets.presses import Presses
from tactibench.plugins.interfaces import KnowsBound, KnowsSurface, Sensor
from tactibench.records.files import read_arrays, write_arrays


def true_surfaces(sensor: Sensor, presses: Presses, grid: Grid) -> npt.NDArray[np.float16] | None:
    """(N, H, W) float16 mm inward displacement of the skin; None where nobody knows it."""
    if not isinstance(sensor, KnowsSurface):
        return None
    name = f"surface-{grid.shape[0]}-{grid.pitch}.npz"
    path = presses.folder / name if presses.folder else None
    if path is not None and path.is_file():
        return read_arrays(path)["surface"]
    surface = np.stack([sensor.surface(scene, grid) for scene in presses.scenes]).astype(np.float16)
    _keep(path, surface=surface)
    return surface


def true_bounds(sensor: Sensor, presses: Presses) -> tuple[FloatArray, ...] | None:
    """(K, 3) mm smallest standard deviation of x, y, depth per press; None where unknown."""
    if not isinstance(sensor, KnowsBound):
        return None
    path = presses.folder / "bound.npz" if presses.folder else None
    if path is not None and path.is_file():
        kept = read_arrays(path)
        return tuple(np.split(kept["bound"], np.cumsum(kept["count"])[:-1]))
    bounds = [sensor.bound(scene) for scene in presses.scenes]
    counts = np.array([len(bound) for bound in bounds], dtype=np.int64)
    _keep(path, bound=np.concatenate(bounds), count=counts)
    return tuple(bounds)


def _keep(path: Path | None, **arrays: npt.NDArray[Any]) -> None:
    if path is not None:
        write_arrays(path, arrays)
