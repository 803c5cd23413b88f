"""What does not move in a frame: vignetting, reflections of the LEDs, the blur's weights."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactibench_sim.optics import Optics

Array = npt.NDArray[np.float64]


def _polar(optics: Optics) -> tuple[Array, Array]:
    """Distance from the principal point, sides, and azimuth, rad, of every pixel."""
    steps = (np.arange(optics.size) - (optics.size - 1) / 2) / optics.size
    x, y = np.meshgrid(steps - optics.principal_x, steps - optics.principal_y)
    return np.hypot(x, y), np.arctan2(y, x) - np.radians(optics.roll_deg)


def vignetting(optics: Optics) -> Array:
    """(H, W) factor on the light: 1 - v (1 - cos^4 a), a the angle in air of the pixel's ray."""
    distance = _polar(optics)[0] / optics.focal
    if optics.lens == "pinhole":
        cosine = 1 / np.sqrt(1 + distance**2)
    else:
        cosine = np.cos(np.minimum(distance, np.pi / 2))
    return 1 - optics.vignetting * (1 - cosine**4)


def glare(optics: Optics) -> Array:
    """(H, W) white light of the LEDs' reflections: arcs that taper to their ends."""
    if not optics.glare or not optics.leds:
        return np.zeros((optics.size, optics.size))
    distance, azimuth = _polar(optics)
    pitch = 2 * np.pi / optics.leds
    along = (azimuth - np.radians(optics.glare_start_deg) + pitch / 2) % pitch - pitch / 2
    taper = 1 - (2 * along / np.radians(optics.glare_arc_deg)) ** 2
    beside = abs(distance - optics.glare_radius) - optics.glare_width / 2 * taper
    edge = optics.edge_px / optics.size
    ramp = np.clip((edge - beside) / (2 * edge), 0, 1) * (taper > 0)
    out: Array = optics.glare * ramp**2 * (3 - 2 * ramp)
    return out


def gaussian_taps(sigma: float) -> Array:
    """Weights of a Gaussian of sigma px, cut at 4 sigma, their sum 1; [1] for sigma 0."""
    steps = np.arange(-int(np.ceil(4 * sigma)), int(np.ceil(4 * sigma)) + 1)
    weights = np.exp(-(steps**2) / (2 * sigma**2)) if sigma else np.ones(1)
    out: Array = weights / weights.sum()
    return out
