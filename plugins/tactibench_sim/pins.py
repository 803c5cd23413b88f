"""Layouts of the pins on the inner skin: directions from the dome's centre at rest.

Both layouts are read from the undeformed frame ``init_0.png`` of a real sensor of the public
Tac-VGNN data (Fan et al., ICRA 2023): radii in the frame, turned into polar angles with camera and
lever of the preset (``camera.TACTIPS``). Seen by that camera, the pins at rest are therefore where
the real ones are. Rotation, offset and aspect of the real frames are left out.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import numpy.typing as npt

from tactibench.geometry import DOME_RADIUS_MM
from tactibench_sim.camera import TACTIPS, Optics
from tactibench_sim.renderer import project

Array = npt.NDArray[np.float64]

RINGS = tuple(r / 360 for r in (0.0, 11.4, 23.0, 34.6, 46.6, 59.3, 72.5, 86.9, 102.3, 118.8, 135.3))
"""Radii of centre pin and rings in the 331-pin frame (360 px), frame sides."""

HEXAGON = (4.42724e-2, 2.01837e-4, 8.98403e-6)
"""Radius = c1 p + c3 p^3 + c5 p^5, frame sides, at p pitches from the centre pin of the 127-pin
frame; least squares with offset, rotation and aspect free, rms residual 0.6 px of 256."""

INNER_MM = 19.0
"""Radius of the nominal inner skin, on which the pins stand."""
_STEEPEST = np.radians(80.0)
"""Polar angle, rad, up to which the place of a pin is sought."""


@cache
def layout(pins: int) -> Array:
    """Return (P, 3) unit vectors, centre pin first, rings outwards, read-only.

    Args:
        pins: 127 or 331.
    """
    preset = TACTIPS[pins]
    radius, azimuth = {127: _hexagon, 331: _rings}[pins]()
    seen, place = np.unique(radius, return_inverse=True)
    polar = polar_angles(seen, preset.optics, INNER_MM - preset.pin_length_mm)[place]
    sine = np.sin(polar)
    out = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar)], axis=1)
    out.setflags(write=False)
    return out


def tip_shares(pins: int) -> Array:
    """Return the (P,) radii of the white tips over that of the centre pin.

    Args:
        pins: 127 or 331.
    """
    q_square = (places_at_rest(pins) ** 2).sum(axis=1)
    q_square /= q_square.max()
    preset = TACTIPS[pins]
    out: Array = 1 + preset.square * q_square + preset.fourth * q_square**2
    return out


def places_at_rest(pins: int) -> Array:
    """Return the (P, 2) places of the pins in the real rest frame, frame sides from the axis.

    Args:
        pins: 127 or 331.
    """
    radius, azimuth = {127: _hexagon, 331: _rings}[pins]()
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth)], axis=1)


def polar_angles(radius: Array, optics: Optics, tip_radius_mm: float) -> Array:
    """Return the (N,) polar angles, rad, of tips that are seen at a distance from the axis.

    Args:
        radius: (N,) distances from the axis in the frame, frame sides.
        optics: The camera; its offset and roll are ignored.
        tip_radius_mm: Distance from the dome's centre to the pins' tips.
    """
    centred = replace(optics, size=1, principal_x=0.0, principal_y=0.0, roll_deg=0.0)
    low, high = np.zeros(len(radius)), np.full(len(radius), _STEEPEST)
    for _ in range(60):  # bisection: seen radii grow with the polar angle
        middle = (low + high) / 2
        inside = _seen(middle, centred, tip_radius_mm) < radius
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return np.where(radius > 0, high, 0.0)


def _seen(polar: Array, optics: Optics, tip_radius_mm: float) -> Array:
    points = tip_radius_mm * np.stack([np.sin(polar), 0 * polar, np.cos(polar)], axis=1)
    x, _, _ = project(optics, points, optics.camera_distance_mm - DOME_RADIUS_MM)
    return x


def _rings() -> tuple[Array, Array]:
    """Return radii, frame sides, and azimuths, rad, of rings of 6 k evenly spaced pins.

    The first pin of every ring is on the x axis.
    """
    radius, azimuth = [0.0], [0.0]
    for k, ring in enumerate(RINGS[1:], start=1):
        radius += [ring] * (6 * k)
        azimuth += [2 * np.pi * j / (6 * k) for j in range(6 * k)]
    return np.array(radius), np.array(azimuth)


def _hexagon() -> tuple[Array, Array]:
    """Return radii, frame sides, and azimuths, rad, of six hexagons of pins around a pin.

    Two corners of the hexagon are on the y axis.
    """
    steps = range(-6, 7)
    cells = [(q, r) for q in steps for r in steps if abs(q + r) <= 6]
    cells.sort(key=lambda cell: max(abs(cell[0]), abs(cell[1]), abs(cell[0] + cell[1])))
    q, r = np.array(cells, dtype=np.float64).T
    x, y = np.sqrt(3) / 2 * r, q + r / 2
    pitch = np.sqrt(q * q + q * r + r * r)  # exactly equal for symmetric pins
    c1, c3, c5 = HEXAGON
    return c1 * pitch + c3 * pitch**3 + c5 * pitch**5, np.arctan2(y, x)
