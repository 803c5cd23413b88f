"""Facts that only a simulator knows of its frames: surfaces, smallest errors, its own error.

Surfaces, bounds and limits are kept beside the frames. The folder's key holds the sensor's code and
tables, so that a file in it always belongs to this simulator.

The two-point limit of a sensor is the spacing from which two contacts differ from one. An ideal
observer knows both frames, that of the two tips and that of the single contact nearest to it, and
decides by their likelihood ratio. It says "two" for 75 % of the pairs, the level of the protocols'
threshold, and for 1 % of the single presses, fewer than a model may have in the catch trials. That
needs d' = z(0.75) + z(0.99) = 3.0. No observer of the same frames reaches it at a smaller spacing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from statistics import NormalDist
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from tactibench.contacts import FloatArray, Grid, Indenter, Scene
from tactibench.errors import UserError
from tactibench.frames.presses import Presses
from tactibench.frames.source import FrameSet
from tactibench.plugins import Sensor
from tactibench.records import digest, read_checked_arrays, write_checked_arrays

Number = TypeVar("Number", bound=np.floating[Any])

SEEN, FALSELY_SEEN = 0.75, 0.01
"""Share of pairs and of single presses that the ideal observer takes for two."""
D_PRIME = NormalDist().inv_cdf(SEEN) - NormalDist().inv_cdf(FALSELY_SEEN)
PRESSES = 40
"""Pairs of a test for which the limit is computed: seconds of work. The limit varies from pose to
pose by a factor of two (exp2: more), so that its median is known to 20 to 40 %."""
_SMALLEST_MM, _LARGEST_MM = 0.01, 20.48
_FIRST_MM = 0.16
"""The first spacing that is tried: near the limit of the simulated sensors."""
_PRECISION = 1e-5
"""Relative precision: a verification on another processor must find the limit in the record."""
_LEAST = 1e-3
"""Smallest d' in the logarithm, which has no value at 0."""


def true_surfaces(sensor: Sensor, presses: Presses, grid: Grid) -> npt.NDArray[np.float16] | None:
    """Return the (N, H, W) inward displacement of the skin, mm; None where it is not known."""
    place = digest([grid.shape, grid.origin, grid.pitch])[:12]

    def compute() -> npt.NDArray[np.float16] | None:
        surfaces = _of_all(presses, lambda scene: sensor.surface(scene, grid))
        return None if surfaces is None else np.stack(surfaces).astype(np.float16)

    return _cached(presses, f"surface-{place}", compute)


def true_bounds(sensor: Sensor, presses: Presses) -> FloatArray | None:
    """Return the (M, 3) Cramer-Rao standard deviations of x, y, depth of all M contacts, mm.

    None where the sensor knows none.
    """

    def compute() -> FloatArray | None:
        bounds = _of_all(presses, sensor.bound)
        return None if bounds is None else np.concatenate(bounds)

    return _cached(presses, "bound", compute)


def true_limits(sensor: Sensor, presses: Presses) -> FloatArray | None:
    """Return the (N,) two-point limits of the presses, mm, nan where none was computed.

    None where the sensor knows none.
    """
    return _cached(presses, "limit", lambda: sampled_limits(sensor, presses.reached()))


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


def spacing_limit(sensor: Sensor, scene: Scene, nuisances: Sequence[str] = ()) -> float | None:
    """Return the smallest spacing, mm, at which two tips at the scene's pose reach d' = 3.0.

    inf: they do not reach it within 20 mm, or one of them does not touch. Spacings below 2 R are
    those of one tool with two tips that overlap. None: the sensor does not know.

    Args:
        sensor: A sensor that knows the noise of its frames.
        scene: Two tips; their own spacing does not matter.
        nuisances: Names of properties that are unknown, see ``Sensor.nuisances``.

    Raises:
        UserError: The sensor refuses a press.
    """
    radius = scene.indenter.radius

    def excess(spacing: float) -> float:
        """Return log(d' / 3.0), which is nearly linear in the logarithm of the spacing."""
        deviance = sensor.deviance(Scene(Indenter.dual(spacing, radius), scene.pose), nuisances)
        return (
            math.nan if deviance is None else math.log(max(math.sqrt(deviance), _LEAST) / D_PRIME)
        )

    from scipy.optimize import brentq

    low = high = _FIRST_MM
    reached = excess(high)
    if math.isnan(reached):
        return None
    while reached <= 0:
        low, high = high, 2 * high
        if high > _LARGEST_MM:
            return math.inf
        reached = excess(high)
    while low == high or excess(low) > 0:
        low, high = low / 2, low
        if low < _SMALLEST_MM:
            return high
    ends = math.log(low), math.log(high)
    return math.exp(brentq(lambda x: excess(math.exp(x)), *ends, xtol=_PRECISION))


def sampled_limits(sensor: Sensor, scenes: Sequence[Scene]) -> FloatArray | None:
    """Return the (N,) limits, mm, of ``PRESSES`` pairs spread evenly over the scenes.

    nan for the other scenes, and for a pair that the sensor refuses. None where the sensor knows no
    limit.
    """
    limits = np.full(len(scenes), np.nan)
    pairs = [row for row, scene in enumerate(scenes) if len(scene.indenter.offsets) == 2]
    if not pairs:
        return limits
    chosen = np.linspace(0, len(pairs) - 1, min(PRESSES, len(pairs))).round().astype(int)
    for row in (pairs[k] for k in chosen):
        try:
            limit = spacing_limit(sensor, scenes[row])
        except UserError:  # such as one whose wider pairs leave the tables; it was pressed narrower
            continue
        if limit is None:
            return None
        limits[row] = limit
    return limits


def _of_all(
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


def _cached(
    presses: Presses, name: str, compute: Callable[[], npt.NDArray[Number] | None]
) -> npt.NDArray[Number] | None:
    """Return the array of a file beside the frames, computed where it is missing or damaged."""
    path = None if presses.folder is None else presses.folder / f"{name}.npz"
    arrays = None if path is None else read_checked_arrays(path)
    if arrays is not None:
        stored: npt.NDArray[Number] = arrays["values"]
        return stored
    values = compute()
    if path is not None and values is not None:
        write_checked_arrays(path, {"values": values})
    return values
