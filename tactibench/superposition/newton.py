"""Least squares of several contacts whose fields add up, by damped Gauss-Newton.

Beside the contacts a frame may depend on a few numbers that nobody asks for: what its sensor
differs by from the mean of its make (``Field.ways``), and how the image has moved. They are fitted
with the contacts, and each is known beforehand to be normal with deviation 1. Against that stands a
misfit whose size nobody knows beforehand: several contacts are superposed with errors far beyond
the camera's noise. So the noise's variance counts as what the fit itself shows, at least 1:

    misfit / s + Q log s + |n|^2,    s = max(misfit / Q, 1)

is minimised, the likelihood of n with the best variance. Misfit beyond the camera's noise is
correlated, so that the sensor's part of |n|^2 then counts more (``compiled.hold_of``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench.superposition.compiled import fit_frame, hold_of
from tactibench.superposition.field import Field

Array = npt.NDArray[np.float64]

_STEPS = 12
"""At most so many steps a frame."""
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
    motions = np.empty((0, moved.shape[1])) if motions is None else motions
    whitener = np.empty((0, 0)) if whitener is None else np.ascontiguousarray(whitener)
    frames, count = start.shape[:2]
    contacts = np.array(start, dtype=np.float64, order="C")
    nuisances = np.zeros((frames, field.ways + len(motions)))
    left = np.empty((frames, whitener.shape[1] if len(whitener) else moved.shape[1]))
    size = 3 * count + nuisances.shape[1]
    normal = np.empty((frames, size, size))
    low = np.array([*field.low[:2], _SHALLOWEST_MM])
    known = field.coefficients, field.low, field.step, field.ways, low, field.high
    weights = np.broadcast_to(np.asarray(weight, dtype=np.float64), left.shape)
    for k in range(frames):
        fit_frame(
            known,
            motions,
            np.ascontiguousarray(moved[k], dtype=np.float64),
            np.ascontiguousarray(weights[k]),
            whitener,
            steps,
            contacts[k],
            nuisances[k],
            left[k],
            normal[k],
        )
    return Solution(contacts, left, _information(normal, 3 * count), nuisances)


def cost_of(solution: Solution, weight: Array, ways: int) -> float:
    """Return the misfit of one frame, and its nuisances' part in units of it.

    Args:
        solution: of the frame.
        weight: (Q,) 1 / variance.
        ways: numbers of the sensor, the first ones among the nuisances.
    """
    misfit = float((weight * solution.left[0] ** 2).sum())
    noise = max(misfit / len(weight), 1.0)
    squares = solution.nuisances[0] ** 2
    squares[:ways] *= hold_of(noise)
    return misfit + noise * float(squares.sum())


def _information(normal: Array, count: int) -> Array:
    """The information on the first ``count`` parameters, the others eliminated (Schur)."""
    if normal.shape[1] == count:
        return normal
    across = normal[:, :count, count:]
    others = np.linalg.solve(normal[:, count:, count:], across.transpose(0, 2, 1))
    information: Array = normal[:, :count, :count] - across @ others
    return information
