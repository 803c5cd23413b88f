"""Views of displacement fields on sensors that differ a little, so that no model relies on them.

On the common lattice two sensors of one make still differ: the camera sits askew, the layout's
outline is read a little too large or off the middle, the skin yields a little more. Every training
frame is shown through such differences, drawn at random.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench.markers import kriging_weights

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Spread:
    """Half-widths of uniform ranges (assumed).

    turn: deg. shift: units of the layout. The others are shares: size of the outline, stretch of
    one axis against the other, gain of the field.
    """

    turn_deg: float = 2.0
    size: float = 0.03
    stretch: float = 0.015
    shift: float = 0.03
    gain: float = 0.05


SPREAD = Spread()


def draw_views(
    points: Array, count: int, rng: np.random.Generator, spread: Spread = SPREAD
) -> tuple[Array, ...]:
    """Return ``count`` matrices (2 L, 2 L), the first of them one.

    Fields (N, 2 L) on the lattice times the transpose are the fields as seen by another sensor.

    With R a turn and D a stretch: v'(x) = gain R' v(D R x + shift), interpolated on the lattice.
    """
    views = [np.eye(2 * len(points))]
    while len(views) < count:
        turn, size, stretch, gain, *shift = rng.uniform(-1.0, 1.0, 6)
        angle = np.radians(spread.turn_deg * turn)
        rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        uneven = 1 + spread.stretch * stretch
        grown = (1 + spread.size * size) * np.array([uneven, 1 / uneven])
        seen = (points @ rotation.T) * grown + spread.shift * np.array(shift)
        weights = (1 + spread.gain * gain) * kriging_weights(points, seen)
        views.append(np.kron(rotation.T, weights))
    return tuple(views)
