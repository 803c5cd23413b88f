"""Least squares of several contacts whose fields add up, by damped Gauss-Newton."""

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
    """(S, 3 K, 3 K) normal matrices."""


def solve(
    field: Field,
    moved: Array,
    start: Array,
    weight: Array,
    steps: int = _STEPS,
    whitener: Array | None = None,
) -> Solution:
    """Minimise sum_q weight_q (moved_q - sum_k field_q(contact_k))^2 over the contacts.

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
    """
    low = np.array([*field.low[:2], _SHALLOWEST_MM])
    high = field.low + field.step * (np.array(field.coefficients.shape[:3]) - 1)
    contacts = start.clip(low, high)
    frames, count = contacts.shape[:2]
    damping = np.full(frames, _DAMPING)
    left, slopes = _residual(field, moved, contacts, whitener)
    weights = np.broadcast_to(weight, left.shape)
    cost = (weights * left**2).sum(axis=1)
    normal, pull = _normal(slopes, weights, left)
    active = np.arange(frames)
    for _ in range(steps):
        scale = np.diagonal(normal[active], axis1=1, axis2=2)
        # A floor, so that a contact too shallow to be felt stays where it is.
        damp = damping[active, None] * (scale + 1e-3 * scale.max(axis=1, keepdims=True))
        matrix = normal[active].copy()
        matrix[:, np.arange(3 * count), np.arange(3 * count)] += damp + 1e-12
        step = np.linalg.solve(matrix, pull[active][..., None])[..., 0].reshape(-1, count, 3)
        longest = (np.abs(step) / _LONGEST).max(axis=(1, 2))
        step /= np.maximum(longest, 1.0)[:, None, None]
        tried = (contacts[active] + step).clip(low, high)
        new_left, new_slopes = _residual(field, moved[active], tried, whitener)
        new_cost = (weights[active] * new_left**2).sum(axis=1)
        better = new_cost <= cost[active]
        moving = np.abs(tried - contacts[active]).max(axis=(1, 2)) > _SMALLEST_STEP_MM
        took = active[better]
        contacts[took], left[took], cost[took] = tried[better], new_left[better], new_cost[better]
        if len(took):
            normal[took], pull[took] = _normal(new_slopes[better], weights[took], new_left[better])
        damping[active] = np.where(better, damping[active] / 8, damping[active] * 10)
        active = active[moving & (damping[active] < 1e6)]
        if not len(active):
            break
    return Solution(contacts, left, normal)


def _residual(
    field: Field, moved: Array, contacts: Array, whitener: Array | None
) -> tuple[Array, Array]:
    """Residuals (S, Q), and the slopes by every contact's x, y and depth (S, 3 K, Q)."""
    values = field.slopes(contacts)
    slopes = values[:, :, 1:].reshape(len(contacts), -1, values.shape[-1])
    left = moved - values[:, :, 0].sum(axis=1)
    return (left, slopes) if whitener is None else (left @ whitener, slopes @ whitener)


def _normal(slopes: Array, weights: Array, left: Array) -> tuple[Array, Array]:
    weighted = slopes * weights[:, None]
    normal: Array = weighted @ slopes.transpose(0, 2, 1)
    pull: Array = (weighted @ left[..., None])[..., 0]
    return normal, pull
