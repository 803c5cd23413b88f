"""Facts that only a simulator knows of its frames: surfaces, smallest errors, its own error.

The first two are kept beside the frames. The folder's key holds the sensor's code and tables, so
that a file in it always belongs to this simulator.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import FloatArray, Grid, Scene
from tactibench.frames.presses import Presses
from tactibench.frames.source import FrameSet
from tactibench.frames.two_point_limit import sampled_limits
from tactibench.plugins import Sensor
from tactibench.records import digest, read_checked_arrays, write_checked_arrays

Arrays = dict[str, npt.NDArray[Any]]


def true_surfaces(sensor: Sensor, presses: Presses, grid: Grid) -> npt.NDArray[np.float16] | None:
    """Return the (N, H, W) inward displacement of the skin, mm; None where it is not known."""
    place = digest([grid.shape, grid.origin, grid.pitch])[:12]

    def compute() -> Arrays | None:
        surfaces = _for_all(presses, lambda scene: sensor.surface(scene, grid))
        return None if surfaces is None else {"surface": np.stack(surfaces).astype(np.float16)}

    arrays = _cached(presses, f"surface-{place}.npz", compute)
    return None if arrays is None else arrays["surface"]


def true_bounds(sensor: Sensor, presses: Presses) -> FloatArray | None:
    """Return the (M, 3) Cramer-Rao standard deviations of x, y, depth of all M contacts, mm.

    None where the sensor knows none.
    """

    def compute() -> Arrays | None:
        bounds = _for_all(presses, sensor.bound)
        return None if bounds is None else {"bound": np.concatenate(bounds)}

    arrays = _cached(presses, "bound.npz", compute)
    return None if arrays is None else arrays["bound"]


def simulator_error(frames: FrameSet) -> dict[str, Any] | None:
    """Return the simulator's own error in a set of frames, as a record states it.

    These are the values of ``records.record.SimulatorError``; None where no sensor made the frames.
    """
    sensor = frames.open_sensor()
    if sensor is None:
        return None
    bounds = sensor.error_bounds(frames.scenes)
    finite = np.zeros(0) if bounds is None else bounds[np.isfinite(bounds)]
    median, p95, largest = (
        (round(float(np.quantile(finite, q)), 4) if len(finite) else None) for q in (0.5, 0.95, 1.0)
    )
    return {
        "name": frames.name,
        "scenes": len(frames.scenes),
        "unknown": len(frames.scenes) - len(finite),
        "median_mm": median,
        "p95_mm": p95,
        "max_mm": largest,
        "terms": dict(sensor.terms(frames.scenes)),
    }


def true_limits(sensor: Sensor, presses: Presses) -> FloatArray | None:
    """Return the (N,) two-point limits of the presses, mm, nan where none was computed.

    None where the sensor knows none.
    """

    def compute() -> Arrays | None:
        limits = sampled_limits(sensor, presses.reached())
        return None if limits is None else {"limit": limits}

    arrays = _cached(presses, "limit.npz", compute)
    return None if arrays is None else arrays["limit"]


def _for_all(
    presses: Presses, compute: Callable[[Scene], FloatArray | None]
) -> list[FloatArray] | None:
    """Return an array for every press; None as soon as the sensor knows nothing of a press."""
    arrays = []
    for scene in presses.reached():
        array = compute(scene)
        if array is None:
            return None
        arrays.append(array)
    return arrays


def _cached(presses: Presses, name: str, compute: Callable[[], Arrays | None]) -> Arrays | None:
    """Return the arrays of a file beside the frames, computed where it is missing or damaged."""
    path = None if presses.folder is None else presses.folder / name
    arrays = None if path is None else read_checked_arrays(path)
    if arrays is None:
        arrays = compute()
        if path is not None and arrays is not None:
            write_checked_arrays(path, arrays)
    return arrays
