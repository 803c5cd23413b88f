"""Pins as soft discs that are fitted together to the grey levels of a frame.

A frame is modelled as dark(x, y) + contrast(x, y) min(1, sum of the discs), with each disc

    s(a) = a^2 (3 - 2 a),   a = (radius + edge - distance) / (2 edge) within 0..1

averaged over a pixel by four points. Centres and radii are found by weighted least squares, pin by
pin in turn with the others' light taken off (block Gauss-Seidel), so that pins which overlap do not
pull at each other. A radius is free because pins come nearer to the camera, but is held loosely to
that at rest. Dark level, contrast, edge and usual radii are those of the sensor at rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from numba import njit

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.uint8]

READ, SHOT = 2.3, 0.0255
"""Variance of a pixel: READ + SHOT x level (1.5 levels of read noise, 10,000 electrons at 255).
It only sets the weights of pixels; a camera with other noise loses little."""
LOOSE = 0.2
"""Standard deviation, as a share of the radius at rest, by which a radius is held to it."""
LARGEST_STEP = 0.6
"""Largest step of a pin in one sweep, px."""
STILL = 2e-4
"""A pin whose last step was shorter is fitted, px."""
_OFF = 0.25
"""A pixel is averaged over four points, the midpoints of its quarters: their distance from its
centre along x and y, px."""
SOFTEST, SHARPEST = 3.0, 0.35
"""Limits between which the half-width of an edge is sought, px."""
FAITHFUL = 0.06
"""A profile is used where it fits the rest frame to this rms, as a share of the contrast."""
_ROUNDS = 3
"""Rounds in which discs are fitted, then the polynomials of dark level and contrast."""
_AROUND = 2.5
"""Width of the ground around a pin that takes part in the fit at rest, px."""


@dataclass(frozen=True, eq=False)
class PinProfile:
    """The profile of pins at rest.

    Attributes:
        dark: (H, W) grey levels without light.
        contrast: (H, W) grey levels of full light over dark ones.
        edge: Half-width of a disc's edge, px.
        disc: (P, 3) x, y and radius, px.
        residual: Rms difference between the rest frame around its pins and the fit, grey levels.
    """

    dark: Array
    contrast: Array
    edge: float
    disc: Array
    residual: float


def fit_profile(image: Images, xy: Array, area: Array) -> PinProfile | None:
    """Return the profile of the pins in a rest frame.

    Dark level and contrast are polynomials, of degree 4 for 60 pins and more: light falls off
    towards the rim.

    Args:
        image: (H, W) uint8, the rest frame.
        xy: (P, 2) centres of the pins, px.
        area: (P,) areas of the pins, px.

    Returns:
        The profile. None where there is nothing to fit: the frame is black and white, has fewer
        than three pins, or its pins are no soft discs.
    """
    if len(xy) < 3 or np.count_nonzero(np.bincount(image.ravel(), minlength=256)) < 8:
        return None
    disc = np.column_stack([xy, np.sqrt(area / np.pi)])
    return _fit_from(image.tobytes(), image.shape, disc.tobytes())


@lru_cache(maxsize=32)  # a fit takes 0.2 s, and models of one process see the same few sensors
def _fit_from(pixels: bytes, shape: tuple[int, int], discs: bytes) -> PinProfile | None:
    """Return the profile of pins as ``fit_profile`` does, from arguments that can be cached.

    Args:
        pixels: Bytes of the rest frame, uint8.
        shape: Height and width of the rest frame.
        discs: Bytes of (P, 3) x, y and radius, px, where the search begins.
    """
    from scipy.optimize import minimize_scalar

    image = np.frombuffer(pixels, dtype=np.uint8).reshape(shape).copy()
    disc = np.frombuffer(discs).reshape(-1, 3).copy()
    xy = disc[:, :2]
    best: list[PinProfile] = []

    def misfit(edge: float) -> float:
        best.append(_profile_with(image, best[-1].disc if best else disc, float(edge)))
        return best[-1].residual

    minimize_scalar(misfit, bounds=(SHARPEST, SOFTEST), method="bounded", options={"xatol": 2e-3})
    profile = min(best, key=lambda each: each.residual)
    contrast = float(np.median(profile.contrast[tuple(np.rint(xy[:, ::-1]).astype(int).T)]))
    return profile if contrast > 0 and profile.residual < FAITHFUL * contrast else None


def _profile_with(image: Images, disc: Array, edge: float) -> PinProfile:
    """Return the best profile whose edge has the half-width ``edge``, px."""
    disc = disc.copy()
    level = image.astype(np.float64)
    terms = _terms(image.shape, 4 if len(disc) >= 60 else 2 if len(disc) >= 20 else 0)
    near = _near(image.shape, disc)
    cover = np.empty(image.shape)
    dark = np.full(image.shape, np.percentile(level[near], 5))
    contrast = np.full(image.shape, np.percentile(level[near], 98)) - dark
    free = np.full(len(disc), np.inf)
    residual = np.inf
    for _ in range(_ROUNDS):
        fit_discs(image, dark, contrast, edge, disc[:, 2].copy(), free, 8, disc, cover)
        light = np.minimum(cover[near], 1.0)
        basis = np.concatenate([terms[near], terms[near] * light[:, None]], axis=1)
        weights, *_ = np.linalg.lstsq(basis, level[near], rcond=None)
        residual = float(np.sqrt(np.mean((basis @ weights - level[near]) ** 2)))
        dark, contrast = (terms @ half for half in np.split(weights, 2))
    return PinProfile(dark, np.maximum(contrast, 1.0), edge, disc, residual)


def _terms(shape: tuple[int, ...], degree: int) -> Array:
    """Return the products of powers of x and y, (H, W, T), with x and y scaled to -1..1."""
    y, x = (np.linspace(-1, 1, side) for side in shape)
    powers = [(a, b) for a in range(degree + 1) for b in range(degree + 1 - a)]
    return np.stack([y[:, None] ** a * x[None] ** b for a, b in powers], axis=-1)


def _near(shape: tuple[int, ...], disc: Array) -> npt.NDArray[np.bool_]:
    """Return (H, W), True around pins; light beyond, such as reflections, is not theirs."""
    out = np.zeros(shape, dtype=np.bool_)
    for x, y, radius in disc:
        wide = radius + _AROUND
        rows = slice(max(0, int(y - wide)), int(y + wide) + 2)
        columns = slice(max(0, int(x - wide)), int(x + wide) + 2)
        out[rows, columns] = True
    return out


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _add_disc(x, y, radius, edge, sign, cover):  # type: ignore[no-untyped-def]
    """Add a disc, times ``sign``, to cover (H, W)."""
    height, width = cover.shape
    reach = radius + edge
    wide = reach + _OFF
    per = 0.5 / edge
    left, right = max(0, math.ceil(x - wide)), min(width - 1, math.floor(x + wide))
    top, bottom = max(0, math.ceil(y - wide)), min(height - 1, math.floor(y + wide))
    for i in range(top, bottom + 1):
        for j in range(left, right + 1):
            total = 0.0
            for half in range(4):
                dy = i - y + (_OFF if half & 1 else -_OFF)
                dx = j - x + (_OFF if half & 2 else -_OFF)
                a = min(max((reach - math.sqrt(dx * dx + dy * dy)) * per, 0.0), 1.0)
                total += a * a * (3.0 - 2.0 * a)
            cover[i, j] += sign * 0.25 * total


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _normal_equations(image, dark, contrast, cover, x, y, radius, edge, m):  # type: ignore[no-untyped-def]
    """Set m (9,) to the weighted sums of a least squares step in x, y and radius of one disc.

    With the Jacobian's columns x, y and r these are xx, xy, xr, yy, yr and rr, then the products of
    x, y and r with the residual.
    """
    height, width = cover.shape
    reach = radius + edge
    wide = reach + _OFF
    per = 0.5 / edge
    left, right = max(0, math.ceil(x - wide)), min(width - 1, math.floor(x + wide))
    top, bottom = max(0, math.ceil(y - wide)), min(height - 1, math.floor(y + wide))
    m[:] = 0.0
    for i in range(top, bottom + 1):
        for j in range(left, right + 1):
            if cover[i, j] > 1.0:
                continue  # full light: nothing is learned from it
            gx, gy, gr = 0.0, 0.0, 0.0
            for half in range(4):
                dy = i - y + (_OFF if half & 1 else -_OFF)
                dx = j - x + (_OFF if half & 2 else -_OFF)
                away = math.sqrt(dx * dx + dy * dy) + 1e-12
                a = min(max((reach - away) * per, 0.0), 1.0)
                slope = a * (1.0 - a)
                gx += slope * dx / away
                gy += slope * dy / away
                gr += slope
            level = dark[i, j] + contrast[i, j] * cover[i, j]
            weight = 1.0 / (READ + SHOT * level)
            scale = 0.25 * 6.0 * per * contrast[i, j]
            gx, gy, gr = gx * scale, gy * scale, gr * scale
            rest = (image[i, j] - level) * weight
            m[0] += weight * gx * gx
            m[1] += weight * gx * gy
            m[2] += weight * gx * gr
            m[3] += weight * gy * gy
            m[4] += weight * gy * gr
            m[5] += weight * gr * gr
            m[6] += gx * rest
            m[7] += gy * rest
            m[8] += gr * rest


@njit(cache=True, nogil=True, error_model="numpy")
def fit_discs(image, dark, contrast, edge, usual, held, sweeps, disc, cover):  # type: ignore[no-untyped-def]
    """Fit discs to a frame by least squares.

    Args:
        image: (H, W) uint8.
        dark: (H, W) grey levels without light.
        contrast: (H, W) grey levels of full light over dark ones.
        edge: Half-width of a disc's edge, px.
        usual: (P,) radii at rest, px.
        held: (P,) standard deviation with which a pin is held to where it starts, px; inf for not
            at all. So a pin that is not seen stays.
        sweeps: Most sweeps over all pins.
        disc: (P, 3) x, y and radius, px, where the fit starts; set to the result.
        cover: (H, W), set to the sum of the discs.
    """
    pins = len(disc)
    cover[:] = 0.0
    start = disc.copy()
    for p in range(pins):
        _add_disc(disc[p, 0], disc[p, 1], disc[p, 2], edge, 1.0, cover)
    m = np.empty(9)
    moved = np.full(pins, np.inf)
    for _ in range(sweeps):
        largest = 0.0
        for p in range(pins):
            if moved[p] < STILL:
                continue
            x, y, r = disc[p, 0], disc[p, 1], disc[p, 2]
            _normal_equations(image, dark, contrast, cover, x, y, r, edge, m)
            hold = 1.0 / held[p] ** 2 + 1e-9
            loose = 1.0 / (LOOSE * usual[p]) ** 2
            xx, yy, rr = m[0] + hold, m[3] + hold, m[5] + loose
            bx = m[6] - hold * (x - start[p, 0])
            by = m[7] - hold * (y - start[p, 1])
            br = m[8] - loose * (r - usual[p])
            # Cholesky of the 3 x 3 matrix
            l0 = math.sqrt(xx)
            l1, l2 = m[1] / l0, m[2] / l0
            l3 = math.sqrt(max(yy - l1 * l1, 1e-12))
            l4 = (m[4] - l1 * l2) / l3
            l5 = math.sqrt(max(rr - l2 * l2 - l4 * l4, 1e-12))
            a = bx / l0
            b = (by - l1 * a) / l3
            dr = (br - l2 * a - l4 * b) / (l5 * l5)
            dy = (b - l4 * dr) / l3
            dx = (a - l1 * dy - l2 * dr) / l0
            step = math.sqrt(dx * dx + dy * dy)
            scale = min(1.0, LARGEST_STEP / (step + 1e-12))
            dr = min(max(dr, -0.3 * usual[p]), 0.3 * usual[p])
            _add_disc(x, y, r, edge, -1.0, cover)
            disc[p, 0] += scale * dx
            disc[p, 1] += scale * dy
            disc[p, 2] = min(max(r + dr, 0.4 * usual[p]), 1.9 * usual[p])
            _add_disc(disc[p, 0], disc[p, 1], disc[p, 2], edge, 1.0, cover)
            moved[p] = step + abs(disc[p, 2] - r)
            largest = max(largest, moved[p])
        if largest < STILL:
            break
