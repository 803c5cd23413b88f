"""Lines from the pins at rest to the pins of a frame."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactibench.errors import UserError
from tactibench.markers import Tracker

Image = npt.NDArray[np.uint8]
Line = tuple[float, float, float, float, bool]
"""x, y at rest and x, y now, px; whether the pin is seen."""


class PinLines:
    """The pins of one sensor.

    A sensor without pins has no lines.
    """

    def __init__(self, rest: Image) -> None:
        """Find the pins in the (H, W) uint8 frame of the untouched sensor."""
        self._tracker: Tracker | None
        try:
            # Centroids take 0.05 ms, and nobody sees an error of a tenth of a pixel on the page.
            self._tracker = Tracker(rest, refine="centroid")
        except UserError:
            self._tracker = None

    def __call__(self, image: Image) -> list[Line]:
        """Return the line of every pin in an (H, W) uint8 frame."""
        if self._tracker is None:
            return []
        tracks = self._tracker.track(image[None])
        rows = np.column_stack([self._tracker.rest, tracks.xy[0]]).tolist()
        return [
            (x0, y0, x, y, bool(seen))
            for (x0, y0, x, y), seen in zip(rows, tracks.seen[0], strict=True)
        ]
