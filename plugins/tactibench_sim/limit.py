"""The smallest errors that camera noise allows: Cramer-Rao bounds of contacts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from tactibench_sim.contact import Tips

Array = npt.NDArray[np.float64]
STEP_MM = 0.004


def bound(
    tips: Tips,
    clean: Callable[[Tips], Array],
    variance: Callable[[Array], npt.NDArray[np.floating]],
) -> Array:
    """(K, 3) mm for the contacts of one scene, in the order of ``true_contacts``.

    All 3 K parameters are unknown together: I = sum over pixels of J J^T / variance, J by central
    differences of the noise-free frame; the bound is sqrt(diag(I^-1)). A contact that moves no
    pixel (it lies in another's dimple) has an infinite bound.
    """
    touching = np.flatnonzero(tips.depth[0] > 0)
    count = len(touching)
    if not count:
        return np.empty((0, 3))
    values = np.column_stack([tips.xy[0, touching], tips.depth[0, touching]]).ravel()
    steps = np.full(3 * count, STEP_MM)
    steps[2::3] = np.minimum(STEP_MM, values[2::3] / 4)
    shifted = values + np.concatenate([np.diag(steps), -np.diag(steps), np.zeros((1, 3 * count))])
    shifted = shifted.reshape(-1, count, 3)
    radius = np.repeat(tips.radius, len(shifted))
    images = clean(Tips(shifted[..., :2], shifted[..., 2], radius)).reshape(len(shifted), -1)
    slopes = (images[: 3 * count] - images[3 * count : -1]) / (2 * steps[:, None])
    return _deviations((slopes / variance(images[-1])) @ slopes.T).reshape(count, 3)


def _deviations(information: Array) -> Array:
    """sqrt(diag(I^-1)); infinite for parameters without information."""
    out = np.full(len(information), np.inf)
    scale = np.sqrt(np.diag(information))
    seen = np.flatnonzero(scale > 0)
    if not len(seen):
        return out
    correlation = information[np.ix_(seen, seen)] / np.outer(scale[seen], scale[seen])
    values, vectors = np.linalg.eigh(correlation)
    with np.errstate(divide="ignore"):
        inverse = np.where(values > 1e-12, 1 / values, np.inf)
    loose = (vectors**2 > 1e-12) & np.isinf(inverse)
    inverse = np.where(np.isinf(inverse), 0.0, inverse)
    spread = (vectors**2 @ inverse) ** 0.5 / scale[seen]
    out[seen] = np.where(loose.any(axis=1), np.inf, spread)
    return out
