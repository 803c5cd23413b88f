"""Least squares of several contacts whose fields add up, by damped Gauss-Newton.

Beside the contacts a frame may depend on a few numbers that nobody asks for: what its sensor
differs by from the mean of its make (``Field.ways``), and how the image has moved. They are fitted
with the contacts, and each is known beforehand to be normal with deviation 1. Against that stands a
misfit whose size nobody knows beforehand: several contacts are superposed with errors far beyond
the camera's noise. So the noise's variance counts as what the fit itself shows, at least 1:

    misfit / s + Q log s + |n|^2,    s = max(misfit / Q, 1)

is minimised, the likelihood of n with the best variance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench.superposition.field import Field

Array = npt.NDArray[np.float64]

_STEPS = 12
"""At most so many steps a frame; it ends earlier when a step is shorter than
``_SMALLEST_STEP_MM``."""
_LONGEST = (0.8, 0.8, 0.8)
"""mm that one step may move a contact in x, y and depth."""
_SMALLEST_STEP_MM = 2e-4
_DAMPING = 1e-4
"""Levenberg-Marquardt damping at the start; it adapts from frame to frame."""
_SMALLEST_NUISANCE = 1e-3
"""The same of a nuisance, in its deviations."""
_SHALLOWEST_MM = 0.02
"""A contact may not become shallower: at depth 0 its place has no effect, and the step no
direction."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Contacts of S frames."""

    contacts: Array
    """(S, K, 3) x, y, depth mm."""
    left: Array
    """(S, Q) displacements that they do not explain."""
    normal: Array
    """(S, 3 K, 3 K) information on the contacts, the nuisances being as unknown as they are."""
    nuisances: Array
    """(S, M) the field's ways of variation, then the image's motions."""


def solve(
    field: Field,
    moved: Array,
    start: Array,
    weight: Array,
    steps: int = _STEPS,
    whitener: Array | None = None,
    motions: Array | None = None,
) -> Solution:
    """Minimise the squared misfit over the contacts and the nuisances n.

        misfit = sum_q weight_q (moved_q - sum_k field_q(contact_k; n) - (n motions)_q)^2

    Levenberg-Marquardt with one damping a frame; a step that does not help is taken back.

    Args:
        field: of one contact.
        moved: (S, Q) displacements.
        start: (S, K, 3) mm.
        weight: (Q,) or (S, Q), 1 / variance.
        steps: at most.
        whitener: (Q, M) by which residuals are multiplied before they are weighted, for
            displacements whose errors are not independent; weight is then (M,) or (S, M), and
            ``left`` of the solution (S, M).
        motions: (R, Q) displacements by each motion of the image; None: it has not moved.
    """
    misfit = _Misfit(field, moved, whitener, _no_motions(moved) if motions is None else motions)
    low = np.array([*field.low[:2], _SHALLOWEST_MM])
    contacts = start.clip(low, field.high)
    frames, count = contacts.shape[:2]
    nuisances = np.zeros((frames, field.ways + len(misfit.motions)))
    damping = np.full(frames, _DAMPING)
    left, slopes = misfit.at(slice(None), contacts, nuisances)
    weights = np.broadcast_to(weight, left.shape)
    cost = _cost(weights, left, nuisances)
    normal, pull = _normal(slopes, weights, left, nuisances)
    diagonal = np.arange(3 * count + nuisances.shape[1])
    active = np.arange(frames)
    for _ in range(steps if len(diagonal) else 0):
        scale = np.diagonal(normal[active], axis1=1, axis2=2)
        # A floor, so that a contact too shallow to be felt stays where it is.
        damp = damping[active, None] * (scale + 1e-3 * scale.max(axis=1, keepdims=True))
        matrix = normal[active].copy()
        matrix[:, diagonal, diagonal] += damp + 1e-12
        both = np.linalg.solve(matrix, pull[active][..., None])[..., 0]
        step, change = both[:, : 3 * count].reshape(len(both), count, 3), both[:, 3 * count :]
        longest = (np.abs(step) / _LONGEST).max(axis=(1, 2), initial=0.0)
        share = 1 / np.maximum(longest, 1.0)
        tried = (contacts[active] + step * share[:, None, None]).clip(low, field.high)
        other = nuisances[active] + change * share[:, None]
        new_left, new_slopes = misfit.at(active, tried, other)
        new_cost = _cost(weights[active], new_left, other)
        better = new_cost <= cost[active]
        moving = np.abs(tried - contacts[active]).max(axis=(1, 2), initial=0) > _SMALLEST_STEP_MM
        moving |= np.abs(change).max(axis=1, initial=0) > _SMALLEST_NUISANCE
        took = active[better]
        contacts[took], left[took], cost[took] = tried[better], new_left[better], new_cost[better]
        nuisances[took] = other[better]
        if len(took):
            normal[took], pull[took] = _normal(
                new_slopes[better], weights[took], new_left[better], other[better]
            )
        damping[active] = np.where(better, damping[active] / 8, damping[active] * 10)
        active = active[moving & (damping[active] < 1e6)]
        if not len(active):
            break
    return Solution(contacts, left, _information(normal, 3 * count), nuisances)


@dataclass(frozen=True, eq=False)
class _Misfit:
    """What contacts and nuisances leave of the displacements."""

    field: Field
    moved: Array
    whitener: Array | None
    motions: Array

    def at(
        self, rows: slice | npt.NDArray[np.intp], contacts: Array, nuisances: Array
    ) -> tuple[Array, Array]:
        """Residuals (S, Q) of some frames, and the slopes of what explains them (S, 3 K + M, Q)."""
        values, ways = self.field.slopes(contacts), self.field.ways
        own = values[..., 0, :]
        if ways:
            own = own + np.einsum("sv,skavq->skaq", nuisances[:, :ways], values[..., 1:, :])
        left = self.moved[rows] - own[:, :, 0].sum(axis=1)
        slopes = own[:, :, 1:].reshape(len(contacts), -1, own.shape[-1])
        if ways:
            slopes = np.concatenate([slopes, values[:, :, 0, 1:].sum(axis=1)], axis=1)
        if len(self.motions):
            left = left - nuisances[:, ways:] @ self.motions
            motions = np.broadcast_to(self.motions, (len(contacts), *self.motions.shape))
            slopes = np.concatenate([slopes, motions], axis=1)
        if self.whitener is None:
            return left, slopes
        return left @ self.whitener, slopes @ self.whitener


def _no_motions(moved: Array) -> Array:
    return np.empty((0, moved.shape[1]))


def variance(misfit: Array, count: int) -> Array:
    """Return the variance of the noise that a misfit of ``count`` values shows, at least 1."""
    size: Array = np.maximum(misfit / count, 1.0)
    return size


def _cost(weights: Array, left: Array, nuisances: Array) -> Array:
    """(S,) the misfit, or with nuisances minus twice the logarithm of their likelihood."""
    misfit: Array = (weights * left**2).sum(axis=1)
    if not nuisances.size:
        return misfit
    size = variance(misfit, left.shape[1])
    cost: Array = misfit / size + left.shape[1] * np.log(size) + (nuisances**2).sum(axis=1)
    return cost


def _normal(slopes: Array, weights: Array, left: Array, nuisances: Array) -> tuple[Array, Array]:
    weighted = slopes * weights[:, None]
    normal: Array = weighted @ slopes.transpose(0, 2, 1)
    pull: Array = (weighted @ left[..., None])[..., 0]
    if nuisances.size:
        size = variance((weights * left**2).sum(axis=1), left.shape[1])[:, None]
        last = np.arange(normal.shape[1] - nuisances.shape[1], normal.shape[1])
        normal[:, last, last] += size
        pull[:, last] -= size * nuisances
    return normal, pull


def _information(normal: Array, count: int) -> Array:
    """The information on the first ``count`` parameters, the others eliminated (Schur)."""
    if normal.shape[1] == count:
        return normal
    across = normal[:, :count, count:]
    others = np.linalg.solve(normal[:, count:, count:], across.transpose(0, 2, 1))
    information: Array = normal[:, :count, :count] - across @ others
    return information
