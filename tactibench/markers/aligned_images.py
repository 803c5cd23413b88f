"""Frames of sensors of one make, seen as the camera of one of them would see them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Frame, Pose
from tactibench.errors import UserError
from tactibench.images import gray_frames
from tactibench.markers.aligned_pins import AlignedPins, Similarity
from tactibench.markers.pin_tracker import PinTracker

Images = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class _Sensor:
    rest: Images
    """As the frames carry it."""
    view: Similarity | None
    """From the reference layout to (size, size) images of this sensor; None: they are the same."""
    seen: Images
    """(size, size), at rest on the reference layout."""


class AlignedImages:
    """Images in which the pins at rest lie, as nearly as a similarity can, on a reference layout.

    Frames of the reference sensor stay as they are, and frames without a rest image are taken for
    its own. So do all frames where the reference sensor shows no pins.

    Attributes:
        rest: (size, size) gray, the reference sensor at rest.
    """

    def __init__(self, rest: Images) -> None:
        self.rest = rest
        self._sensors: list[_Sensor] = []

    @classmethod
    def of(cls, frames: Sequence[Frame], size: int) -> Self | None:
        """Return those on the layout of the first frame's sensor; None: a frame has no rest image.

        size: of the images, px.
        """
        rests = [rest for frame in frames if (rest := frame.rest_image) is not None]
        return cls(_sized(rests[0], size)) if frames and len(rests) == len(frames) else None

    def __call__(self, frames: Sequence[Frame]) -> Images:
        """Return (N, 2, size, size): every frame, and its sensor at rest.

        Raises:
            UserError: for a sensor whose pins are not those of the reference.
        """
        out = np.empty((len(frames), 2, *self.rest.shape), dtype=np.uint8)
        out[:, 0], out[:, 1] = gray_frames(frames, len(self.rest)), self.rest
        for row, frame in enumerate(frames):
            if (rest := frame.rest_image) is not None:
                sensor = self._sensor(rest)
                out[row, 1] = sensor.seen
                if sensor.view is not None:
                    out[row, 0] = _seen_from(out[row, 0], sensor.view)
        return out

    def _sensor(self, rest: Images) -> _Sensor:
        for known in self._sensors:
            if known.rest is rest or np.array_equal(known.rest, rest):
                return known
        size = len(self.rest)
        own, view = _sized(rest, size), None
        if self._layout is not None and not np.array_equal(own, self.rest):
            pins = PinTracker.of([Frame(rest, 0.0, Pose(), rest)])
            view = _resizing(pins.side, size).after(AlignedPins(pins, self._layout).view)
        seen = own if view is None else _seen_from(own, view)
        self._sensors.append(_Sensor(rest, view, seen))
        return self._sensors[-1]

    @cached_property
    def _layout(self) -> npt.NDArray[np.float64] | None:
        """(P, 2) px of the reference sensor's pins; None: it shows none."""
        try:
            return PinTracker(self.rest).rest
        except UserError:
            return None


def _sized(rest: Images, size: int) -> Images:
    (image,) = gray_frames([Frame(rest, 0.0, Pose())], size)
    return np.asarray(image)


def _resizing(side: int, size: int) -> Similarity:
    """From places in an image of ``side`` px to those in the same of ``size`` px.

    Places are those of pixels' centres: the first corner lies at -1/2 in both.
    """
    ratio = size / side
    return Similarity(ratio * np.eye(2), np.full(2, (ratio - 1) / 2))


def _seen_from(image: Images, view: Similarity) -> Images:
    """(S, S) image whose pixels lie at ``view`` of their own places; the border is repeated."""
    import cv2

    placed = np.column_stack([view.matrix, view.shift])
    how = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    warped = cv2.warpAffine(
        image, placed, image.shape[::-1], flags=how, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(warped, dtype=np.uint8)
