"""Frames of sensors of one make, seen as the camera of one of them would see them.

Pins are looked for only where a frame is of another sensor than the first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Frame, Pose
from tactibench.errors import UserError
from tactibench.images import gray_frames

if TYPE_CHECKING:
    from tactibench.markers.alignment import Similarity

Images = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class _Sensor:
    """A sensor whose frames were seen.

    Attributes:
        rest: The rest image as the frames carry it.
        view: From the reference layout to (size, size) images of this sensor; None: they are the
            same.
        seen: (size, size) rest image on the reference layout.
    """

    rest: Images
    view: Similarity | None
    seen: Images


class AlignedImages:
    """Images in which the pins at rest lie, as nearly as a similarity can, on a reference layout.

    Frames of the reference sensor stay as they are. Frames without a rest image are taken for its
    frames. Where the reference sensor shows no pins, all frames stay as they are.

    Attributes:
        rest: (size, size) gray, the reference sensor at rest.
    """

    def __init__(self, rest: Images) -> None:
        self.rest = rest
        self._sensors: list[_Sensor] = []

    @classmethod
    def of(cls, frames: Sequence[Frame], size: int) -> Self | None:
        """Return images on the layout of the first frame's sensor.

        Args:
            frames: Frames of sensors of one make.
            size: Height and width of the images, px.

        Returns:
            The images; None where there is no frame or a frame has no rest image.
        """
        rests = [rest for frame in frames if (rest := frame.rest_image) is not None]
        return cls(_sized(rests[0], size)) if frames and len(rests) == len(frames) else None

    def __call__(self, frames: Sequence[Frame]) -> Images:
        """Return (N, 2, size, size): every frame, and its sensor at rest.

        Raises:
            UserError: A sensor's pins are not those of the reference sensor.
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
        for sensor in self._sensors:
            if sensor.rest is rest or np.array_equal(sensor.rest, rest):
                return sensor
        size = len(self.rest)
        image, view = _sized(rest, size), None
        if not np.array_equal(image, self.rest) and self._layout is not None:
            from tactibench.markers.alignment import AlignedPins, Similarity
            from tactibench.markers.pin_tracker import PinTracker

            pins = PinTracker.of([Frame(rest, 0.0, Pose(), rest)])
            # Places are those of pixels' centres: the first corner lies at -1/2 in both images.
            ratio = size / pins.side
            resizing = Similarity(ratio * np.eye(2), np.full(2, (ratio - 1) / 2))
            view = resizing.after(AlignedPins(pins, self._layout).view)
        seen = image if view is None else _seen_from(image, view)
        self._sensors.append(_Sensor(rest, view, seen))
        return self._sensors[-1]

    @cached_property
    def _layout(self) -> npt.NDArray[np.float64] | None:
        """(P, 2) px of the reference sensor's pins; None: it shows none."""
        from tactibench.markers.pin_tracker import PinTracker

        try:
            return PinTracker(self.rest).rest
        except UserError:
            return None


def _sized(rest: Images, size: int) -> Images:
    (image,) = gray_frames([Frame(rest, 0.0, Pose())], size)
    return np.asarray(image)


def _seen_from(image: Images, view: Similarity) -> Images:
    """Return the (S, S) image whose pixel at x shows ``image`` at ``view(x)``.

    Beyond the border of ``image`` its outermost pixels are repeated.
    """
    import cv2

    placed = np.column_stack([view.matrix, view.shift])
    how = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    warped = cv2.warpAffine(
        image, placed, image.shape[::-1], flags=how, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(warped, dtype=np.uint8)
