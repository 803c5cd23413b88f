"""What else may be unknown of a camera, as derivatives of one noise-free frame.

The frame is taken as a cubic spline through its pixels (Unser, IEEE Signal Proc. Mag. 16(6), 1999),
so that nothing has to be known of the optics that made it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.ndimage import spline_filter1d

from tactibench import UserError

Array = npt.NDArray[np.float64]


def derivatives(image: Array, names: Sequence[str]) -> Array:
    """(D, H, W) d image / d nuisance; ``shift`` has two parameters, the others one.

    Raises UserError for a name that is none of ``NUISANCES``.
    """
    for name in names:
        if name not in _DERIVATIVES:
            raise UserError(
                f"the simulated sensor has no nuisance {name!r}; it has {', '.join(NUISANCES)}."
            )
    frame = _Frame(image)
    found = [rows for name in dict.fromkeys(names) for rows in _DERIVATIVES[name](frame)]
    return np.concatenate([np.empty((0, *image.shape)), *(row[None] for row in found)])


class _Frame:
    """A frame (H, W) with its slopes dx, dy, grey levels a pixel, and the pixels' places."""

    def __init__(self, image: Array) -> None:
        self.image = image
        rows, columns = image.shape
        self.x = np.arange(columns)[None, :] - (columns - 1) / 2
        self.y = np.arange(rows)[:, None] - (rows - 1) / 2

    @cached_property
    def dx(self) -> Array:
        return _first(self.image, 1)

    @cached_property
    def dy(self) -> Array:
        return _first(self.image, 0)


def _first(image: Array, axis: int) -> Array:
    """f' = (c[i+1] - c[i-1]) / 2 of a cubic spline with coefficients c, mirrored at the ends."""
    c = np.moveaxis(spline_filter1d(image, order=3, axis=axis, mode="mirror"), axis, 0)
    wide = np.concatenate([c[1:2], c, c[-2:-1]])
    return np.moveaxis((wide[2:] - wide[:-2]) / 2, 0, axis)


def _laplacian(frame: _Frame) -> Array:
    """First differences twice: of fourth order, where a spline's own f'' is of second."""
    return _first(frame.dx, 1) + _first(frame.dy, 0)


_DERIVATIVES: dict[str, Callable[[_Frame], list[Array]]] = {
    "shift": lambda f: [-f.dx, -f.dy],
    "roll": lambda f: [f.y * f.dx - f.x * f.dy],
    "zoom": lambda f: [-f.x * f.dx - f.y * f.dy],
    "brightness": lambda f: [f.image],
    "background": lambda f: [np.ones_like(f.image)],
    # by the heat equation, d image / d (sigma^2 / 2) of a Gaussian blur is the Laplacian
    "blur": lambda f: [_laplacian(f)],
}
NUISANCES = tuple(_DERIVATIVES)
"""The camera moved in its plane; turned about its axis; its magnification; a gain of all grey
levels; an offset of all grey levels; its focus."""
