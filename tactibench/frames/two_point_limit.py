"""The two-point limit of a sensor: the spacing from which two contacts differ from one.

An ideal observer knows both frames, that of the two tips and that of the single contact nearest to
it, and decides by their likelihood ratio. It says "two" for 75 % of the pairs, the level of the
protocols' threshold, and for 1 % of the single presses, fewer than a model may have in the catch
trials. That needs d' = z(0.75) + z(0.99) = 3.0. No observer of the same frames reaches it at a
smaller spacing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist

import numpy as np
from scipy.optimize import brentq

from tactibench.contacts import FloatArray, Indenter, Scene
from tactibench.errors import UserError
from tactibench.plugins import Sensor

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
