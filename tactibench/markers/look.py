"""How pins look in the frames of one sensor: dark level, contrast, edge and radii, from rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.uint8]

SOFTEST, SHARPEST = 3.0, 0.35
"""Range in which the half-width of an edge is sought, px."""
FAITHFUL = 0.06
"""A look is taken where it gives the rest frame to this rms, of the contrast."""
_ROUNDS = 3
_AROUND = 2.5


@dataclass(frozen=True, eq=False)
class Look:
    """What ``fit`` needs. dark, contrast: (H, W) grey levels; edge: px; disc: (P, 3) at rest."""

    dark: Array
    contrast: Array
    edge: float
    disc: Array
    residual: float


def look(image: Images, xy: Array, area: Array) -> Look | None:
    """The look of pins at xy (P, 2) px of these areas in the rest frame (H, W).

    None for a frame that is black and white, or in which pins are no soft discs: there is nothing
    to fit. Dark level and contrast are polynomials, of degree 4 with 60 pins and more: light falls
    off towards the rim.
    """
    from scipy.optimize import minimize_scalar

    if len(xy) < 3 or np.count_nonzero(np.bincount(image.ravel(), minlength=256)) < 8:
        return None
    disc = np.column_stack([xy, np.sqrt(area / np.pi)])
    best: list[Look] = []

    def misfit(edge: float) -> float:
        best.append(_look_with(image, best[-1].disc if best else disc, float(edge)))
        return best[-1].residual

    minimize_scalar(misfit, bounds=(SHARPEST, SOFTEST), method="bounded", options={"xatol": 2e-3})
    found = min(best, key=lambda one: one.residual)
    contrast = float(np.median(found.contrast[tuple(np.rint(xy[:, ::-1]).astype(int).T)]))
    return found if contrast > 0 and found.residual < FAITHFUL * contrast else None


def _look_with(image: Images, disc: Array, edge: float) -> Look:
    """The best look with this edge."""
    from tactibench.markers.fit import fit

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
        fit(image, dark, contrast, edge, disc[:, 2].copy(), free, 8, disc, cover)
        light = np.minimum(cover[near], 1.0)
        basis = np.concatenate([terms[near], terms[near] * light[:, None]], axis=1)
        weights, *_ = np.linalg.lstsq(basis, level[near], rcond=None)
        residual = float(np.sqrt(np.mean((basis @ weights - level[near]) ** 2)))
        dark, contrast = (terms @ half for half in np.split(weights, 2))
    return Look(dark, np.maximum(contrast, 1.0), edge, disc, residual)


def _terms(shape: tuple[int, ...], degree: int) -> Array:
    """(H, W, T) products of powers of x and y, scaled to -1..1."""
    y, x = (np.linspace(-1, 1, side) for side in shape)
    powers = [(a, b) for a in range(degree + 1) for b in range(degree + 1 - a)]
    return np.stack([y[:, None] ** a * x[None] ** b for a, b in powers], axis=-1)


def _near(shape: tuple[int, ...], disc: Array) -> npt.NDArray[np.bool_]:
    """(H, W) pixels around pins: what lies beyond, reflections say, is none of theirs."""
    out = np.zeros(shape, dtype=np.bool_)
    for x, y, radius in disc:
        wide = radius + _AROUND
        rows = slice(max(0, int(y - wide)), int(y + wide) + 2)
        columns = slice(max(0, int(x - wide)), int(x + wide) + 2)
        out[rows, columns] = True
    return out
