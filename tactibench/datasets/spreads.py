"""The place about which pins spread, and how far they spread."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def spread_of(moved: FloatArray) -> FloatArray:
    """Return the root mean square distance of pins' displacements from their mean.

    Args:
        moved: (N, P, 2) displacements of P pins, px.

    Returns:
        (N,) px.
    """
    centred = moved - moved.mean(axis=1, keepdims=True)
    spread: FloatArray = np.sqrt((centred**2).sum(axis=2).mean(axis=1))
    return spread


def middle_of_spread(moved: FloatArray, rest: FloatArray) -> FloatArray:
    """Return the (N, 2) place, px from the mean pin, about which the pins of a press spread.

    The lines through the pins along their displacements pass it closest, in least squares weighted
    by the displacements. An even shift of all pins is taken out first.

    Args:
        moved: (N, P, 2) displacements of P pins, px.
        rest: (P, 2) places of the pins at rest, px.
    """
    centred = moved - moved.mean(axis=1, keepdims=True)
    normal = np.stack([-centred[..., 1], centred[..., 0]], axis=-1)
    places = rest - rest.mean(axis=0)
    square = np.einsum("npi,npj->nij", normal, normal)
    trace = np.trace(square, axis1=1, axis2=2)[:, None, None]
    square += 1e-9 * np.maximum(trace, 1e-9) * np.eye(2)  # nothing moves: the mean pin
    right = np.einsum("npi,npj,pj->ni", normal, normal, places)
    return np.asarray(np.linalg.solve(square, right[..., None])[..., 0], dtype=np.float64)


def direction_of(middle: FloatArray, tilt: FloatArray) -> tuple[float, float]:
    """Return where a positive tilt moves the contact, and how closely the contact follows.

    Args:
        middle: (N, 2) places from ``middle_of_spread``, px.
        tilt: (N,) tilts of the plate, deg.

    Returns:
        Direction on the frame, deg, 0: right, 90: down; correlation of the place along it with
        the sine of the tilt.
    """
    sine = np.sin(np.radians(tilt))
    slope = np.linalg.lstsq(np.column_stack([np.ones(len(sine)), sine]), middle, rcond=None)[0][1]
    along = middle @ slope
    alike = float(np.corrcoef(along, sine)[0, 1]) if np.ptp(along) > 0 else 0.0
    return math.degrees(math.atan2(slope[1], slope[0])), alike


def lean_of(shift: FloatArray, tilt: FloatArray, shear: FloatArray | None = None) -> float:
    """Return where on the frame a positive tilt moves the contact, deg: 0 right, 90 down.

    Args:
        shift: (N, 2) mean displacement of a press's pins, px; they lean away from the contact.
        tilt: (N,) tilts of the plate, deg.
        shear: (N, S) labels of how the plate was dragged along.
    """
    columns = np.zeros((len(tilt), 0)) if shear is None else shear
    terms = np.column_stack([np.ones(len(tilt)), np.sin(np.radians(tilt)), columns])
    away = np.linalg.lstsq(terms, shift, rcond=None)[0][1]
    return math.degrees(math.atan2(-away[1], -away[0]))
