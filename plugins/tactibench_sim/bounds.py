"""What camera noise allows: Cramer-Rao bounds of contacts, and the deviance of two from one.

Pixels are independent Gaussians of mean m(p) and variance v(m), so the information on parameters p
is (Kay, Fundamentals of Statistical Signal Processing I, 1993, eq. 3.31)

    I = sum over pixels of dm/dp dm/dp^T w,   w = 1 / v + v'^2 / (2 v^2),   v' = dv/dm.

The second part of w is what the strength of the shot noise itself tells; it is below 0.1 % here.
All parameters are unknown together: the covariance is a block of I^-1. Unknown properties of the
camera (*nuisances*) enter as derivatives of the noise-free frame, which is taken as a cubic spline
through its pixels (Unser, IEEE Signal Proc. Mag. 16(6), 1999), so that the optics that made it need
not be known. The coefficient of friction is a nuisance of sensors that rub: it enters by a
difference of frames.

Whether two contacts can be told from one is said by their difference, measured in the noise of a
frame. Let m2 be the noise-free frame of two tips, v the variance of its pixels, and m1(x, y, depth)
that of one tip of the same radius. The log likelihood ratio of "two" against the single contact
nearest to it is Gaussian under both, one standard deviation wide and d' apart (Kay, Fundamentals of
Statistical Signal Processing II, 1998, section 4.3), with

    d'^2 = D = min over x, y, depth of sum over pixels of (m2 - m1)^2 / v.

The minimum is found by Gauss-Newton from the middle of the tips. Unknown properties of the camera
are estimated, too: the part of the difference that looks like the frame's derivatives by them is
removed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.ndimage import spline_filter1d

from tactibench import UserError
from tactibench_sim.camera import NUISANCES
from tactibench_sim.contact import Tips

Array = npt.NDArray[np.float64]
_Look = Callable[[Array], tuple[Array, Array]]
Clean = Callable[[Tips], npt.NDArray[np.floating]]
"""Tips of S scenes -> (S, H, W) frames without noise."""
Variance = Callable[[Array], npt.NDArray[np.floating]]
"""A frame without noise -> the variance of every pixel."""

STEP_MM = 0.004
"""Step of the differences: bounds change by less than 0.1 % for 0.001 to 0.01 mm (tests)."""
FRICTION = "friction"
"""The nuisance of a sensor with friction: its coefficient, the same for all tips of a press."""
STEP_FRICTION = 0.002
"""Step of the differences by the coefficient of friction, at most a quarter of it."""
_NOTHING = 1e-10
"""Share of a parameter's information that counts as none; rounding leaves 1e-13."""
_CONVERGED = 1e-6
"""The search ends where a further step would lower D by less than this share of max(D, 1): a d' of
1 cannot be seen."""
_STEPS = 30
_HALVINGS = 6
_RANK = 1e-6
"""Singular value, as a share of the largest, below which a nuisance adds nothing to the others."""


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
        nuisances: What else is unknown: FRICTION, and properties of the camera, names of
            ``NUISANCES``. They are estimated from the same frame, with no prior.
        step: Step of the central differences, mm.
    """
    count = 3 * int((tips.depth[0] > 0).sum())
    if not count:
        return np.empty((0, 0))
    return inverse(marginal(information(tips, clean, variance, nuisances, step), count))


def information(
    tips: Tips, clean: Clean, variance: Variance, nuisances: Sequence[str], step: float = STEP_MM
) -> Array:
    """Return the information on x, y, depth of every contact, on friction, and on the camera.

    Arguments are those of ``covariance``; at least one tip touches. The coefficient of friction is
    a parameter where ``nuisances`` name it.
    """
    slopes, image = _slopes(tips, clean, step)
    around = [np.asarray(variance(image + d), dtype=np.float64).ravel() for d in (-0.5, 0.0, 0.5)]
    weight = 1 / around[1] + ((around[2] - around[0]) / around[1]) ** 2 / 2
    every = np.concatenate([slopes, _others(tips, clean, image, nuisances)])
    out: Array = (every * weight) @ every.T
    return out


def _others(tips: Tips, clean: Clean, image: Array, nuisances: Sequence[str]) -> Array:
    """Return the (N, H W) slopes of the grey levels by friction, if it is unknown, and the camera.

    Args:
        tips: One scene.
        clean: Renders frames without noise.
        image: (H, W) frame of the scene.
        nuisances: As of ``covariance``.
    """
    if FRICTION not in nuisances or tips.friction is None:
        return derivatives(image, nuisances).reshape(-1, image.size)
    camera = [name for name in nuisances if name != FRICTION]
    step = np.minimum(STEP_FRICTION, tips.friction / 4)
    both = tips.take(np.zeros(2, dtype=np.intp))
    both = replace(both, friction=np.concatenate([tips.friction + step, tips.friction - step]))
    more, less = np.asarray(clean(both), dtype=np.float64).reshape(2, -1)
    rest = derivatives(image, camera).reshape(-1, image.size)
    return np.concatenate([(more - less)[None] / (2 * step), rest])


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
    some = tips.take(np.zeros(len(shifted), dtype=np.intp))
    move = None if some.move is None else some.move[:, touching]
    around = replace(some, xy=shifted[..., :2], depth=shifted[..., 2], move=move)
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


def deviance(tips: Tips, clean: Clean, variance: Variance, nuisances: Sequence[str] = ()) -> float:
    """Return D of one scene; 0 where fewer than two of its tips touch.

    Args:
        tips: One scene.
        clean: Renders frames without noise.
        variance: Returns the variance of every pixel of a frame.
        nuisances: What is unknown beside the contacts, as of ``covariance``.
    """
    touching = tips.depth[0] > 0
    if touching.sum() < 2:
        return 0.0
    two = np.asarray(clean(tips), dtype=np.float64)[0]
    weight = 1 / np.sqrt(np.asarray(variance(two), dtype=np.float64).ravel())
    look_alike = _others(tips, clean, two, nuisances) * weight
    _, sizes, rows = np.linalg.svd(look_alike, full_matrices=False)
    explained = rows[sizes > _RANK * sizes.max(initial=0.0)]

    seven = tips.take(np.zeros(7, dtype=np.intp))
    if seven.move is not None:  # the one contact went as far as the mean of both
        seven = replace(seven, move=seven.move[:, touching].mean(axis=1, keepdims=True))

    def visible(frames: Array) -> Array:
        """Return frames (F, H W) in standard deviations, without what the nuisances explain."""
        scaled = frames * weight
        return np.asarray(scaled - (scaled @ explained.T) @ explained)

    def look(place: Array) -> tuple[Array, Array]:
        """Return the differences (H W,) at a place and the slopes (3, H W) of the single frame.

        Both are in standard deviations. The place is x, y, depth, mm.
        """
        step = min(STEP_MM, place[2] / 4)
        around = place + step * np.concatenate([np.eye(3), -np.eye(3), np.zeros((1, 3))])
        single = replace(seven, xy=around[:, None, :2], depth=around[:, None, 2])
        images = np.asarray(clean(single), dtype=np.float64).reshape(7, -1)
        slopes = (images[:3] - images[3:6]) / (2 * step)
        return visible((two.ravel() - images[6])[None])[0], visible(slopes)

    middle = tips.xy[0, touching].mean(axis=0)
    return _nearest(look, np.array([*middle, tips.depth[0, touching].max()]))


def _nearest(look: _Look, place: Array) -> float:
    """Return the least sum of squares that Gauss-Newton reaches from a place.

    Where the sensor refuses the next single press because its tables end, the sum that the linear
    step predicts is returned.

    Args:
        look: Returns the differences and the slopes at a place.
        place: (3,) x, y, depth, mm.
    """
    left, slopes = look(place)
    for _ in range(_STEPS):
        before = float(left @ left)
        step = np.linalg.lstsq(slopes.T, left, rcond=None)[0]
        after = float(((left - step @ slopes) ** 2).sum())
        if before - after <= _CONVERGED * max(before, 1.0):
            break
        for _ in range(_HALVINGS):
            ahead = place + step
            if ahead[2] > 0:
                try:
                    seen = look(ahead)
                except UserError:
                    return after
                if float(seen[0] @ seen[0]) < before:
                    break
            step = step / 2
        else:
            return before
        place, (left, slopes) = ahead, seen
    return after
