"""Least squares of several contacts whose fields add up, by damped Gauss-Newton.

Besides the contacts a frame may depend on a few nuisances n: the numbers by which its sensor
differs from the mean of its make (``Field.ways``), and the motion of the image. They are fitted
together with the contacts; the prior of each is normal with standard deviation 1. The size of the
misfit is not known beforehand: several contacts are superposed with errors far beyond the camera's
noise. So the variance s of the noise follows from the fit itself and is at least 1:

    misfit / s + Q log s + |n|^2,    s = max(misfit / Q, 1)

is minimised. This is the likelihood of n with the best variance. Misfit beyond the camera's noise
is correlated, so the sensor's part of |n|^2 then counts more (``compiled.hold_of``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench.superposition.compiled import fit_frame, hold_of
from tactibench.superposition.field import Field

Array = npt.NDArray[np.float64]

_STEPS = 12
"""Most steps of a frame."""
_SHALLOWEST_MM = 0.02
"""Smallest depth of a contact: at depth 0 its place has no effect, and a step no direction."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Contacts of S frames.

    Attributes:
        contacts: (S, K, 3) x, y, depth, mm.
        left: (S, Q) residual displacements.
        normal: (S, 3 K, 3 K) information on the contacts, with the nuisances unknown.
        nuisances: (S, M) numbers of the field's ways of variation, then of the image's motions.
    """

    contacts: Array
    left: Array
    normal: Array
    nuisances: Array


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

    The method is Levenberg-Marquardt with one damping per frame; a step that does not help is taken
    back.

    Args:
        field: Field of one contact.
        moved: (S, Q) displacements.
        start: (S, K, 3) x, y and depth at which the fit starts, mm.
        weight: (Q,) or (S, Q), 1 / variance.
        steps: Most steps of a frame.
        whitener: (Q, M) by which residuals are multiplied before they are weighted, for
            displacements whose errors are not independent; weight is then (M,) or (S, M), and
            ``left`` of the solution (S, M).
        motions: (R, Q) displacements by each motion of the image; None where it has not moved.
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
    arrays = field.coefficients, field.low, field.step, field.ways, low, field.high
    weights = np.broadcast_to(np.asarray(weight, dtype=np.float64), left.shape)
    for k in range(frames):
        fit_frame(
            arrays,
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
    """Return the misfit of one frame plus the penalty of its nuisances in units of the misfit.

    Args:
        solution: Solution of the frame.
        weight: (Q,) 1 / variance.
        ways: Number of the nuisances that are numbers of the sensor; they are the first.
    """
    misfit = float((weight * solution.left[0] ** 2).sum())
    noise = max(misfit / len(weight), 1.0)
    squares = solution.nuisances[0] ** 2
    squares[:ways] *= hold_of(noise)
    return misfit + noise * float(squares.sum())


def _information(normal: Array, count: int) -> Array:
    """Return the information on the first ``count`` parameters, with the others eliminated.

    This is the Schur complement.
    """
    if normal.shape[1] == count:
        return normal
    across = normal[:, :count, count:]
    others = np.linalg.solve(normal[:, count:, count:], across.transpose(0, 2, 1))
    information: Array = normal[:, :count, :count] - across @ others
    return information
