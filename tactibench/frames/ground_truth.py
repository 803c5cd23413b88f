"""What a simulator knows beyond the frames, kept beside them: surfaces and bounds.

The folder's key holds the sensor's code and tables, so a file in it is of this simulator.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import FloatArray, Grid, Scene
from tactibench.errors import UserError
from tactibench.frames.presses import Presses
from tactibench.plugins.base import Sensor
from tactibench.records.files import arrays_hash, read_arrays, write_arrays
from tactibench.records.identity import digest

Arrays = dict[str, npt.NDArray[Any]]


def true_surfaces(sensor: Sensor, presses: Presses, grid: Grid) -> npt.NDArray[np.float16] | None:
    """(N, H, W) float16 mm inward displacement of the skin; None where nobody knows it."""
    place = digest([grid.shape, grid.origin, grid.pitch])[:12]

    def compute() -> Arrays | None:
        surfaces = _known_of_all(presses, lambda scene: sensor.surface(scene, grid))
        return None if surfaces is None else {"surface": np.stack(surfaces).astype(np.float16)}

    kept = _kept(presses, f"surface-{place}.npz", compute)
    return None if kept is None else kept["surface"]


def true_bounds(sensor: Sensor, presses: Presses) -> tuple[FloatArray, ...] | None:
    """(K, 3) mm smallest standard deviation of x, y, depth per press; None where unknown."""

    def compute() -> Arrays | None:
        bounds = _known_of_all(presses, sensor.bound)
        if bounds is None:
            return None
        counts = np.array([len(bound) for bound in bounds], dtype=np.int64)
        return {"bound": np.concatenate(bounds), "count": counts}

    kept = _kept(presses, "bound.npz", compute)
    if kept is None:
        return None
    return tuple(np.split(kept["bound"], np.cumsum(kept["count"])[:-1]))


def _known_of_all(
    presses: Presses, ask: Callable[[Scene], FloatArray | None]
) -> list[FloatArray] | None:
    """What the sensor knows of every press; None as soon as it knows nothing of one."""
    found = []
    for scene in presses.reached():
        one = ask(scene)
        if one is None:
            return None
        found.append(one)
    return found


def _kept(presses: Presses, name: str, compute: Callable[[], Arrays | None]) -> Arrays | None:
    """The arrays of a file beside the frames, computed when it is missing or damaged."""
    path: Path | None = presses.folder / name if presses.folder else None
    if path is not None:
        try:
            stored = read_arrays(path)
            seal = str(stored.pop("seal", ""))
            if seal == arrays_hash(stored):
                return stored
        except UserError:
            pass  # not there, or damaged: it can be computed
    arrays = compute()
    if path is not None and arrays is not None:
        write_arrays(path, {**arrays, "seal": np.array(arrays_hash(arrays))})
    return arrays
