"""The deviance of two contacts from one: their difference, measured in the noise of a frame.

Let m2 be the noise-free frame of two tips, v the variance of its pixels, and m1(x, y, depth) that
of one tip of the same radius. The log likelihood ratio of "two" against the single contact nearest
to it is Gaussian under both, one standard deviation wide and d' apart (Kay, Fundamentals of
Statistical Signal Processing II, 1998, section 4.3), with

    d'^2 = D = min over x, y, depth of sum over pixels of (m2 - m1)^2 / v.

The minimum is found by Gauss-Newton from the middle of the tips. Unknown properties of the camera
are estimated, too: the part of the difference that looks like the frame's derivatives by them is
removed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from tactibench import UserError
from tactibench_sim.bounds import STEP_MM, Clean, Variance, derivatives
from tactibench_sim.mechanics.contact import Tips

Array = npt.NDArray[np.float64]
_Look = Callable[[Array], tuple[Array, Array]]

_CONVERGED = 1e-6
"""The search ends where a further step would lower D by less than this share of max(D, 1): a d' of
1 cannot be seen."""
_STEPS = 30
_HALVINGS = 6
_RANK = 1e-6
"""Singular value, as a share of the largest, below which a nuisance adds nothing to the others."""


def deviance(tips: Tips, clean: Clean, variance: Variance, nuisances: Sequence[str] = ()) -> float:
    """Return D of one scene; 0 where fewer than two of its tips touch.

    Args:
        tips: One scene.
        clean: Renders frames without noise.
        variance: Returns the variance of every pixel of a frame.
        nuisances: Unknown properties of the camera, names of ``NUISANCES``.
    """
    touching = tips.depth[0] > 0
    if touching.sum() < 2:
        return 0.0
    two = np.asarray(clean(tips), dtype=np.float64)[0]
    weight = 1 / np.sqrt(np.asarray(variance(two), dtype=np.float64).ravel())
    look_alike = derivatives(two, nuisances).reshape(-1, two.size) * weight
    _, sizes, rows = np.linalg.svd(look_alike, full_matrices=False)
    explained = rows[sizes > _RANK * sizes.max(initial=0.0)]

    move = None  # the one contact went as far as the mean of both
    if tips.move is not None:
        move = np.repeat(tips.move[:, touching].mean(axis=1, keepdims=True), 7, axis=0)

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
        single = Tips(around[:, None, :2], around[:, None, 2], np.repeat(tips.radius, 7), move)
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
