"""Frames as displacements of the pins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tactibench import Frame, UserError
from tactibench.superposition import Eye

Array = npt.NDArray[np.float64]


def eye_of(frames: Sequence[Frame], known: Array) -> Eye:
    """Follows the pins from their places in the rest image of the first frame that has one, or
    else in the frame that is pressed least. known: (N, T) targets, the depth of a plate first, that
    of a contact last."""
    depth = known[:, 0] if known.shape[1] == 2 else known[:, -1]
    return Eye.of(frames, otherwise=frames[int(np.argmin(depth))])


def displacements(eye: Eye | None, frames: Sequence[Frame], model: str) -> Array:
    """(N, 2 P) px, x of all pins, then y of all. Raises UserError before anything is learned."""
    if eye is None:
        raise UserError(f"model {model!r} knows no pins yet; train it or load weights first.")
    return eye.moved(eye.images(frames))
