"""Which marker of a frame is which marker of the undeformed layout."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactibench.errors import UserError
from tactibench.markers.assign import assign
from tactibench.markers.detect import Markers
from tactibench.markers.smooth import Layout, foretell, largest_part, layout, odd

Array = npt.NDArray[np.float64]

FARTHEST = 3.0
"""No marker is looked for farther from where it is guessed to be than this many pitches."""
ODD = 0.45
"""A displacement is refused where it leaves what its neighbours foretell by this many pitches."""
ENOUGH = 4
"""Known neighbours from which on a marker's displacement is foretold."""
_REPAIRS = 3


def match(markers: Markers, rest: Array) -> Array:
    """(P, 2) positions, px, of the layout's markers in the frame; NaN where one is not seen.

    rest: (P, 2) positions in the undeformed frame, px. The first guess is the assignment of least
    total squared distance, which is right wherever markers move by less than half a pitch and for
    most spreading and compressing beyond. Its largest part in which neighbours move alike is
    believed; from its edge the rest is found anew, each marker where its neighbours foretell it.
    One that fits nowhere is not seen, and a blob that fits nobody is none. Raises UserError for a
    layout of fewer than three markers or with NaN.
    """
    rest = np.asarray(rest, dtype=np.float64)
    if rest.ndim != 2 or rest.shape[1] != 2 or len(rest) < 3 or not np.isfinite(rest).all():
        raise UserError(
            f"the layout has shape {rest.shape}; it must be (P, 2) with at least three finite rows."
        )
    found = np.full(rest.shape, np.nan)
    if not len(markers):
        return found
    blobs = markers.xy
    shape = layout(np.ascontiguousarray(rest))
    which = assign(rest, blobs, np.full(len(rest), FARTHEST * float(np.median(shape.pitch))))
    believed = largest_part(_moved(which, blobs, rest), shape)
    which = _complete(np.where(believed, which, -1), blobs, rest, shape)
    seen = which >= 0
    found[seen] = blobs[which[seen]]
    return found


def _complete(
    which: npt.NDArray[np.intp],
    blobs: Array,
    rest: Array,
    shape: Layout,
) -> npt.NDArray[np.intp]:
    """Grow from what is known; take back what does not fit its neighbours, and grow again."""
    for _ in range(_REPAIRS):
        which = _grow(which, blobs, rest, shape)
        off = odd(_moved(which, blobs, rest), rest, shape, ODD)
        if not off.any():
            break
        which[off] = -1
    return which


def _moved(which: npt.NDArray[np.intp], blobs: Array, rest: Array) -> Array:
    """(P, 2) displacements, NaN where there is none."""
    moved: Array = np.where((which >= 0)[:, None], blobs[which] - rest, np.nan)
    return moved


def _grow(
    which: npt.NDArray[np.intp],
    blobs: Array,
    rest: Array,
    shape: Layout,
) -> npt.NDArray[np.intp]:
    """Assign markers beside known ones, layer by layer, to the blobs nobody has."""
    which = which.copy()
    while True:
        known = which >= 0
        edge = ~known & (known[shape.near].sum(axis=1) >= min(ENOUGH, shape.near.shape[1]))
        if not edge.any() or known.sum() == len(blobs):
            return which
        free = np.setdiff1d(np.arange(len(blobs)), which[known])
        expected = rest[edge] + foretell(_moved(which, blobs, rest), rest, shape, edge)
        now = assign(expected, blobs[free], ODD * shape.pitch[edge])
        if not (now >= 0).any():
            return which
        which[np.flatnonzero(edge)[now >= 0]] = free[now[now >= 0]]
