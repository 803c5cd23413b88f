"""Where the pins stand on the inner skin: directions from the dome's centre at rest.

Both layouts are read from the undeformed frame ``init_0.png`` of a real sensor of the public
Tac-VGNN data (Fan et al., ICRA 2023), assuming the reference camera of ``optics.Camera``: pins of
2 mm whose tips lie 17 mm from the dome's centre, seen from 35 mm below it with a focal length of
1.0294 frame sides. Rotation, offset and aspect of those frames are left out.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_RING_POLAR_DEG = (5.37, 10.86, 16.36, 22.05, 28.06, 34.34, 41.23, 48.67, 56.70, 64.95)
"""Ring radii 11.4 ... 135.3 px of the 331-pin frame (360 px), as polar angles."""

_HEX_POLAR_DEG = (7.56961, 0.0290806, 0.00176995)
"""Polar angle = c1 p + c3 p^3 + c5 p^5 at p pitches from the centre pin of the 127-pin frame;
rms residual 0.6 px of 256."""


def layout(pins: int) -> Array:
    """(P, 3) unit vectors, centre pin first, rings outwards. pins: 127 or 331."""
    polar, azimuth = {127: _hexagon, 331: _rings}[pins]()
    sine = np.sin(polar)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar)], axis=1)


def _rings() -> tuple[Array, Array]:
    """Rings of 6 k pins, evenly spaced, one pin of each on the x axis."""
    polar, azimuth = [0.0], [0.0]
    for k, angle in enumerate(_RING_POLAR_DEG, start=1):
        polar += [math.radians(angle)] * (6 * k)
        azimuth += [2 * math.pi * j / (6 * k) for j in range(6 * k)]
    return np.array(polar), np.array(azimuth)


def _hexagon(rings: int = 6) -> tuple[Array, Array]:
    """A hexagonal array with two corners on the y axis, bent onto the dome."""
    cells = [
        (q, r) for q in range(-rings, rings + 1) for r in range(-rings, rings + 1)
        if abs(q + r) <= rings
    ]  # fmt: skip
    cells.sort(key=lambda cell: max(abs(cell[0]), abs(cell[1]), abs(cell[0] + cell[1])))
    q, r = np.array(cells, dtype=np.float64).T
    x, y = math.sqrt(3) / 2 * r, q + r / 2
    pitch = np.hypot(x, y)
    c1, c3, c5 = _HEX_POLAR_DEG
    return np.radians(c1 * pitch + c3 * pitch**3 + c5 * pitch**5), np.arctan2(y, x)
