"""Offset and pivot behind the labels of a plate, from how far its presses move the pins.

indentation = z + a + p (1 - cos t), z the depth label, t the tilt label. The spread of a press is
the root mean square displacement of its pins about their mean, which an even shift of all pins
leaves alone. It vanishes at first touch, grows with a power of the indentation, and depends on the
tilt besides only through the perspective of the camera:

    log spread = b + k log(z + a + p (1 - cos t)) + c1 t + c2 t^2 + c3 t^3 + c4 t^4 + shear

Labels rarely reach first touch, and then the exponent k and the offset a cannot be told apart: k is
taken from simulated plate presses of known indentation, and its uncertainty is part of the result.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from tactibench.errors import UserError

FloatArray = npt.NDArray[np.float64]

EXPONENT, EXPONENT_STD = 1.37, 0.05
"""k of plates on simulated domes with 331 (1.42) and 127 pins (1.32), 1 to 5 mm deep, up to 20 deg;
with an offset of 5 mm the recordings of Tac-VGNN have 1.37 and 1.39."""
PIVOT_BIAS_STD = 1.2
"""mm by which p is off on those simulated presses: perspective changes more than a factor."""
FEWEST = 50
FAINT = 0.05
"""A press that moves the pins by less than this share of the strongest does not touch for sure."""
_DEGREE = 4
_NEAREST_MM = 1e-3
_ROUNDS = 3


@dataclass(frozen=True)
class Pivot:
    """a and p, mm, with their standard deviations; scatter: what more presses make smaller.

    residual: median relative misfit of the spread. presses: that were fitted.
    """

    offset_mm: float
    pivot_mm: float
    offset_std: float
    pivot_std: float
    offset_scatter: float
    pivot_scatter: float
    exponent: float
    residual: float
    presses: int


def spread_of(moved: FloatArray) -> FloatArray:
    """(N,) px of the displacements (N, P, 2) of P pins: their rms distance from their mean."""
    centred = moved - moved.mean(axis=1, keepdims=True)
    spread: FloatArray = np.sqrt((centred**2).sum(axis=2).mean(axis=1))
    return spread


def lean_of(shift: FloatArray, tilt: FloatArray, shear: FloatArray | None = None) -> float:
    """Where on the frame a positive tilt moves the contact to, deg: 0 right, 90 down.

    shift: (N, 2) px, mean displacement of a press's pins; they lean away from the contact. tilt:
    (N,) deg. shear: (N, S) labels of how the plate was dragged along, or None.
    """
    columns = np.zeros((len(tilt), 0)) if shear is None else shear
    terms = np.column_stack([np.ones(len(tilt)), np.sin(np.radians(tilt)), columns])
    away = np.linalg.lstsq(terms, shift, rcond=None)[0][1]
    return math.degrees(math.atan2(-away[1], -away[0]))


def fit_pivot(
    spread: FloatArray,
    depth: FloatArray,
    tilt: FloatArray,
    shear: FloatArray | None = None,
    exponent: float = EXPONENT,
    exponent_std: float = EXPONENT_STD,
) -> Pivot:
    """Fit a and p.

    spread: (N,), of any unit. depth: (N,) labels mm, larger = deeper. tilt: (N,) deg. shear:
    (N, S) labels of how the plate was dragged along, or None. Raises UserError for too few presses
    that touch, and for labels of which depth or tilt never changes.
    """
    keep = spread > FAINT * np.quantile(spread, 0.95)
    if np.count_nonzero(keep) < FEWEST:
        raise UserError(
            f"{np.count_nonzero(keep)} presses move the pins; at least {FEWEST} are needed to fit "
            "offset and pivot."
        )
    columns = np.zeros((len(spread), 0)) if shear is None else shear
    spread, depth, tilt, columns = (one[keep] for one in (spread, depth, tilt, columns))
    for name, values in (("depth", depth), ("tilt", tilt)):
        if np.ptp(values) < 1e-6:
            raise UserError(
                f"the {name} label is the same in all presses, so that offset and pivot cannot be "
                "told apart; fit a recording in which it changes, or name another column."
            )
    found = _fit(spread, depth, tilt, columns, exponent)
    low, high = (
        _fit(spread, depth, tilt, columns, exponent + sign * exponent_std) for sign in (-1, 1)
    )
    return replace(
        found,
        offset_std=math.hypot(found.offset_scatter, (high.offset_mm - low.offset_mm) / 2),
        pivot_std=math.hypot(
            found.pivot_scatter, (high.pivot_mm - low.pivot_mm) / 2, PIVOT_BIAS_STD
        ),
    )


def _fit(
    spread: FloatArray, depth: FloatArray, tilt: FloatArray, shear: FloatArray, exponent: float
) -> Pivot:
    """The fit with one exponent; the residuals' tails weigh linearly (soft l1)."""
    log = np.log(spread)
    lifted = 1 - np.cos(np.radians(tilt))
    linear = _terms(tilt / np.abs(tilt).max(), shear)

    def residuals(x: FloatArray) -> FloatArray:
        indented = np.maximum(depth + x[0] + x[1] * lifted, _NEAREST_MM)
        return np.asarray(exponent * np.log(indented) + linear @ x[2:] - log, dtype=np.float64)

    start = np.zeros(2 + linear.shape[1])
    start[0] = 1.0 - depth.min()  # the shallowest press about 1 mm deep
    start[2] = float(log.mean())
    x, scale = start, 0.1
    for _ in range(_ROUNDS):
        solved = least_squares(residuals, x, loss="soft_l1", f_scale=scale, x_scale="jac")
        x = solved.x
        scale = max(float(1.4826 * np.median(np.abs(residuals(x)))), 1e-9)
    misfit = residuals(x)
    # Huber's sandwich for an M-estimate: psi of soft l1 is r / sqrt(1 + (r / scale)^2).
    tail = 1 + (misfit / scale) ** 2
    jacobian = _jacobian(depth, lifted, linear, x, exponent)
    inverse = np.linalg.pinv((jacobian * tail[:, None] ** -1.5).T @ jacobian)
    half = jacobian * (misfit * tail**-0.5)[:, None]
    scatter = np.sqrt(np.diag(inverse @ (half.T @ half) @ inverse))
    return Pivot(
        float(x[0]),
        float(x[1]),
        float(scatter[0]),
        float(scatter[1]),
        float(scatter[0]),
        float(scatter[1]),
        exponent,
        float(np.median(np.abs(misfit))),
        len(spread),
    )


def _terms(tilt: FloatArray, shear: FloatArray) -> FloatArray:
    """(N, T) one, powers of the tilt (-1..1), and of each shear s, s^2 and s t."""
    columns = [tilt**power for power in range(_DEGREE + 1)]
    for values in shear.T:
        largest = np.abs(values).max()
        if largest > 0:
            scaled = values / largest
            columns += [scaled, scaled**2, scaled * tilt]
    return np.column_stack(columns)


def _jacobian(
    depth: FloatArray, lifted: FloatArray, linear: FloatArray, x: FloatArray, exponent: float
) -> FloatArray:
    slope = exponent / np.maximum(depth + x[0] + x[1] * lifted, _NEAREST_MM)
    return np.column_stack([slope, slope * lifted, linear])
