"""The assignment of blobs to places of least total squared distance, within a gate."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def assign(places: Array, blobs: Array, gate: Array) -> npt.NDArray[np.intp]:
    """(P,) index of the blob of each place (P, 2), -1 for none within its gate (P,).

    blobs: (N, 2). A blob is taken once. A place without a blob costs its gate squared.
    """
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial.distance import cdist

    which = np.full(len(places), -1, dtype=np.intp)
    if not len(blobs) or not len(places):
        return which
    square = cdist(places, blobs, "sqeuclidean")
    row, column = linear_sum_assignment(np.minimum(square, gate[:, None] ** 2))
    good = square[row, column] < gate[row] ** 2
    which[row[good]] = column[good]
    return which
