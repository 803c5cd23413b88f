"""Cramer-Rao bounds of contacts: the smallest errors that camera noise allows.

Pixels are independent Gaussians of mean m(p) and variance v(m), so the information on parameters p
is (Kay, Fundamentals of Statistical Signal Processing I, 1993, eq. 3.31)

    I = sum over pixels of dm/dp dm/dp^T w,   w = 1 / v + v'^2 / (2 v^2),   v' = dv/dm.

The second part of w is what the strength of the shot noise itself tells; it is below 0.1 % here.
All parameters are unknown together: the covariance is a block of I^-1. Unknown properties of the
camera (*nuisances*) enter as derivatives of the noise-free frame, which is taken as a cubic spline
through its pixels (Unser, IEEE Signal Proc. Mag. 16(6), 1999), so that the optics that made it need
not be known.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.ndimage import spline_filter1d

from tactibench import UserError
from tactibench_sim.mechanics.contact import Tips
from tactibench_sim.optics.camera import NUISANCES

Array = npt.NDArray[np.float64]
Clean = Callable[[Tips], npt.NDArray[np.floating]]
"""Tips of S scenes -> (S, H, W) frames without noise."""
Variance = Callable[[Array], npt.NDArray[np.floating]]
"""A frame without noise -> the variance of every pixel."""

STEP_MM = 0.004
"""Step of the differences: bounds change by less than 0.1 % for 0.001 to 0.01 mm (tests)."""
_NOTHING = 1e-10
"""Share of a parameter's information that counts as none; rounding leaves 1e-13."""


def covariance(
    tips: Tips,
    clean: Clean,
    variance: Variance,
    nuisances: Sequence[str] = (),
    step: float = STEP_MM,
) -> Array:
    """Return the (3 K, 3 K) mm^2 bound on x, y, depth of every contact of one scene.

    A parameter about which the frame says nothing has an infinite variance and no covariances. This
    holds for a contact in another's dimple and for two contacts at one place.

    Args:
        tips: One scene; contacts are ordered as in ``true_contacts``.
        clean: Renders frames without noise.
        variance: Returns the variance of every pixel of a frame.
        nuisances: Unknown properties of the camera, names of ``NUISANCES``. They are estimated from
            the same frame, with no prior.
        step: Step of the central differences, mm.
    """
    if not (tips.depth[0] > 0).any():
        return np.empty((0, 0))
    slopes, image = _slopes(tips, clean, step)
    around = [np.asarray(variance(image + d), dtype=np.float64).ravel() for d in (-0.5, 0.0, 0.5)]
    weight = 1 / around[1] + ((around[2] - around[0]) / around[1]) ** 2 / 2
    every = np.concatenate([slopes, derivatives(image, nuisances).reshape(-1, image.size)])
    return inverse(marginal((every * weight) @ every.T, len(slopes)))


def deviations(covariance: Array) -> Array:
    """Return the (K, 3) mm standard deviations of a (3 K, 3 K) covariance."""
    out: Array = np.sqrt(np.diag(covariance)).reshape(-1, 3)
    return out


def _slopes(tips: Tips, clean: Clean, step: float) -> tuple[Array, Array]:
    """Return the (3 K, H W) slopes of the grey levels by x, y and depth, per mm, and the frame.

    One call of ``clean`` renders all 6 K + 1 frames. A step in depth is at most a quarter of the
    depth, so that the contact does not end.
    """
    touching = np.flatnonzero(tips.depth[0] > 0)
    count = len(touching)
    values = np.column_stack([tips.xy[0, touching], tips.depth[0, touching]]).ravel()
    steps = np.full(3 * count, step)
    steps[2::3] = np.minimum(step, values[2::3] / 4)
    shifted = values + np.concatenate([np.diag(steps), -np.diag(steps), np.zeros((1, 3 * count))])
    shifted = shifted.reshape(-1, count, 3)
    radius = np.repeat(tips.radius, len(shifted))
    move = None if tips.move is None else np.repeat(tips.move[:, touching], len(shifted), axis=0)
    around = Tips(shifted[..., :2], shifted[..., 2], radius, move)
    images = np.asarray(clean(around), dtype=np.float64)
    slopes = (images[: 3 * count] - images[3 * count : -1]) / (2 * steps[:, None, None])
    return slopes.reshape(3 * count, -1), images[-1]


def marginal(information: Array, kept: int) -> Array:
    """Return the (kept, kept) information on the first parameters when the others are unknown.

    It is the Schur complement A - B C^-1 B^T of [[A, B], [B^T, C]], in units in which every
    diagonal element is 1. C may be singular: a parameter that moves no pixel costs nothing.

    Args:
        information: (N, N) information on all parameters.
        kept: Number of the first parameters.
    """
    scale = np.sqrt(np.diag(information))
    unit = np.where(scale > 0, scale, 1.0)
    scaled = information / np.outer(unit, unit)
    a, b, c = scaled[:kept, :kept], scaled[:kept, kept:], scaled[kept:, kept:]
    left = a - b @ np.linalg.pinv(c, rcond=_NOTHING, hermitian=True) @ b.T
    lost = np.diag(left) < _NOTHING
    left[lost], left[:, lost] = 0.0, 0.0
    out: Array = left * np.outer(unit[:kept], unit[:kept])
    return out


def inverse(information: Array) -> Array:
    """Return the inverse of I; inf on the diagonal for parameters without information.

    I is scaled first. A parameter is without information also where it takes part in a combination
    that has none.
    """
    out = np.diag(np.full(len(information), np.inf))
    scale = np.sqrt(np.diag(information))
    seen = np.flatnonzero(scale > 0)
    if not len(seen):
        return out
    unit = np.outer(scale[seen], scale[seen])
    values, vectors = np.linalg.eigh(information[np.ix_(seen, seen)] / unit)
    lost = values < _NOTHING
    loose = (vectors[:, lost] ** 2 > _NOTHING).any(axis=1)
    inner = (vectors[:, ~lost] / values[~lost]) @ vectors[:, ~lost].T / unit
    inner[loose], inner[:, loose] = 0.0, 0.0
    inner[loose, loose] = np.inf
    out[np.ix_(seen, seen)] = inner
    return out


def derivatives(image: Array, names: Sequence[str]) -> Array:
    """Return the (D, H, W) derivatives of an image by nuisances; ``shift`` has two, others one.

    Args:
        image: (H, W) grey levels.
        names: Names of ``NUISANCES``; a repeated one counts once.

    Raises:
        UserError: A name is none of ``NUISANCES``.
    """
    for name in names:
        if name not in _DERIVATIVES:
            raise UserError(
                f"the simulated sensor has no nuisance {name!r}; it has {', '.join(NUISANCES)}."
            )
    frame = _Frame(image)
    slopes = [slope for name in dict.fromkeys(names) for slope in _DERIVATIVES[name](frame)]
    return np.concatenate([np.empty((0, *image.shape)), *(slope[None] for slope in slopes)])


class _Frame:
    """A frame (H, W), its slopes dx and dy in grey levels per pixel, and the pixels' places."""

    def __init__(self, image: Array) -> None:
        self.image = image
        rows, columns = image.shape
        self.x = np.arange(columns)[None, :] - (columns - 1) / 2
        self.y = np.arange(rows)[:, None] - (rows - 1) / 2

    @cached_property
    def dx(self) -> Array:
        return _first(self.image, 1)

    @cached_property
    def dy(self) -> Array:
        return _first(self.image, 0)


def _first(image: Array, axis: int) -> Array:
    """Return f' = (c[i+1] - c[i-1]) / 2 of a cubic spline with coefficients c, mirrored at ends."""
    c = np.moveaxis(spline_filter1d(image, order=3, axis=axis, mode="mirror"), axis, 0)
    wide = np.concatenate([c[1:2], c, c[-2:-1]])
    return np.moveaxis((wide[2:] - wide[:-2]) / 2, 0, axis)


def _laplacian(frame: _Frame) -> Array:
    """Return the Laplacian by taking first derivatives twice.

    Its error is of fourth order; that of a spline's own second derivative is of second order.
    """
    return _first(frame.dx, 1) + _first(frame.dy, 0)


_DERIVATIVES: dict[str, Callable[[_Frame], list[Array]]] = {
    "shift": lambda f: [-f.dx, -f.dy],
    "roll": lambda f: [f.y * f.dx - f.x * f.dy],
    "zoom": lambda f: [-f.x * f.dx - f.y * f.dy],
    "brightness": lambda f: [f.image],
    "background": lambda f: [np.ones_like(f.image)],
    # by the heat equation, d image / d (sigma^2 / 2) of a Gaussian blur is the Laplacian
    "blur": lambda f: [_laplacian(f)],
}
"""One entry for each of ``NUISANCES``."""
