"""Smooth corrections on the dome: vector fields around a direction, learned from finite elements.

A *patch* is a small field around a middle direction m, given in the frame (e, f, m) of whatever it
corrects: e points from one contact to the other, or down the dome's side; the plane of e and m is
a mirror plane. Positions are Lambert's equal-area coordinates: a point at the angle r from m in the
direction (cos, sin) of the tangent plane lies at 2 sin(r / 2) (cos, sin), its chord on the unit
sphere; they cost one square root. Vectors are kept by their components along e, f, m, so nothing is
singular at the middle.

Patches come as a linear combination of a few fixed modes. The coefficients are cubic splines of
the contact's parameters, the modes cubic splines of the position: everything is twice continuously
differentiable and ends smoothly at the patch's border.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.ndimage import spline_filter1d

Array = npt.NDArray[np.float64]
_AHEAD = 12  # nodes of odd reflection; the filter's memory of the border is 0.27 a node


def coefficients(values: Array, axes: Sequence[int]) -> Array:
    """Cubic B-spline coefficients of values on uniform nodes, one more at each end of every axis.

    The ends are natural: the second derivative vanishes there.
    """
    out = np.asarray(values, dtype=np.float64)
    for axis in axes:
        ahead = min(_AHEAD, out.shape[axis] - 1)
        width = [(ahead, ahead) if k == axis else (0, 0) for k in range(out.ndim)]
        longer = np.pad(out, width, mode="reflect", reflect_type="odd")
        filtered = spline_filter1d(longer, 3, axis=axis, mode="mirror")
        keep = [slice(None)] * out.ndim
        keep[axis] = slice(ahead - 1, filtered.shape[axis] - ahead + 1)
        out = filtered[tuple(keep)]
    return np.ascontiguousarray(out)
