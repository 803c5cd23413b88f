"""Frames of one sensor as displacements of its pins."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Generic, Self, TypeVar

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Frame, Pose
from tactibench.errors import UserError
from tactibench.images import gray_frames
from tactibench.markers.tracker import Tracker

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Images = npt.NDArray[np.uint8]

Made = TypeVar("Made")

_GROUND, _PINS = 0.5, 0.97
"""Quantiles of a frame's grey levels that are ground and pins; pins cover 5 to 20 % of a frame."""
_FAINTEST_LIGHT = 0.05
"""Share of the rest frame's light below which noise would be taken for pins."""
_COVER = 1.25
"""Factor by which brighter pins may cover more of a frame than at rest; beyond it a reflection is
taken for pins. Blurred pins cover more and are darker."""
_ALIKE = 0.05
"""Relative difference of light below which a frame has the light of the rest frame: pins that move
under a lens differ as much."""
_SAME_GROUND, _LEVELS = 0.05, 1.0
"""Share of its grey level, and number of levels, by which the ground may differ from what the pins'
light predicts: levels are whole numbers, and a dark ground has few."""
_SATURATED = 250
"""Grey level of pins from which they may be brighter than the camera shows."""
_DOUBTFUL = 2.5
"""Pins at rest within this many spacings of a pin that was not seen may be one pin off."""


def rest_images(frames: Sequence[Frame]) -> list[Images]:
    """Return the different rest images that the frames carry, one for each sensor instance."""
    rests = (frame.rest_image for frame in frames)
    by_array = {id(rest): rest for rest in rests if rest is not None}
    different = {(image.shape, image.tobytes()): image for image in by_array.values()}
    return list(different.values())


class BySensor(Generic[Made]):
    """One object for every sensor whose frames were seen; rest images tell sensors apart."""

    def __init__(self, make: Callable[[PinTracker], Made]) -> None:
        """Take the function ``make``, which makes the object of a sensor from its pins."""
        self._make = make
        self._made: list[tuple[Images, Made]] = []

    def number(self, frame: Frame) -> int:
        """Return the number of the frame's sensor, 0 for the first one that was seen.

        Raises:
            UserError: The frame has no rest image, its rest image shows no pins, or ``make``
                refuses the sensor.
        """
        rest = frame.rest_image
        if rest is None:
            raise UserError(
                "a frame carries no rest image, by which a sensor's pins are told from another's; "
                "record one of the untouched sensor (init_0.png)."
            )
        for number, (other, _) in enumerate(self._made):
            if other is rest or (other.shape == rest.shape and np.array_equal(other, rest)):
                return number
        self._made.append((rest, self._make(PinTracker.of([frame]))))
        return len(self._made) - 1

    def __getitem__(self, number: int) -> Made:
        """Return the object that was made for the sensor of a number."""
        return self._made[number][1]

    def rows(self, frames: Sequence[Frame]) -> dict[int, list[int]]:
        """Return the number of each sensor -> rows of its frames.

        Raises:
            UserError: A frame has no rest image, a rest image shows no pins, or ``make`` refuses a
                sensor.
        """
        numbers = [self.number(frame) for frame in frames]
        return {n: [row for row, m in enumerate(numbers) if m == n] for n in sorted(set(numbers))}


class PinTracker:
    """The pins of one sensor, tracked from their places in its rest image.

    Attributes:
        rest_image: (side, side) gray, the untouched sensor.
        tracker: The tracker of its pins.
    """

    def __init__(self, rest_image: Images) -> None:
        """Find the pins at rest.

        Args:
            rest_image: (side, side) gray, the untouched sensor.

        Raises:
            UserError: The rest image shows no pins.
        """
        self.rest_image = rest_image
        self.tracker = Tracker(rest_image)

    @classmethod
    def of(cls, frames: Sequence[Frame], otherwise: Frame | None = None) -> Self:
        """Return the tracker of the rest image that the frames carry.

        Args:
            frames: Frames of one sensor.
            otherwise: A frame that is hardly pressed, for frames without a rest image.

        Raises:
            UserError: The frames are of several sensor instances, there is neither a rest image nor
                ``otherwise``, or the image that is used shows no pins.
        """
        rests = rest_images(frames)
        if len(rests) > 1:
            raise UserError(
                f"the frames are of {len(rests)} sensor instances, but here pins are followed from "
                "one rest frame; train on one (sensor.instances=0), or train superpose, vgnn, "
                "mixture, kernel, pins, nearest or unet."
            )
        rest = rests[0] if rests else None
        if rest is None and otherwise is not None:
            rest = otherwise.image
        if rest is None:
            raise UserError(
                "the frames carry no rest image, from which the pins' places are taken; record one "
                "of the untouched sensor, or use a model without pins (unet, cnn)."
            )
        return cls(gray_frames([Frame(rest, 0.0, Pose())], max(rest.shape[:2]))[0])

    @property
    def side(self) -> int:
        """Side of the images, px."""
        return len(self.rest_image)

    @property
    def rest(self) -> Array:
        """Pins at rest, (P, 2) px."""
        return self.tracker.rest

    def images(self, frames: Sequence[Frame]) -> Images:
        """Return (N, side, side) gray images in the light of the rest image."""
        images = gray_frames(frames, self.side)
        for row, image in enumerate(images):
            images[row] = self._lit(image)
        return images

    def _lit(self, image: Images) -> Images:
        """Return an image (side, side), brought to the light of the rest image if it has another.

        It stays as it is where its light is as at rest or too faint, and where it changed in a way
        that no lamp explains.
        """
        ground, contrast, cover = _light(image)
        rest_ground, rest_contrast, rest_cover = self._light
        factor = contrast / rest_contrast
        if abs(factor - 1) < _ALIKE or factor < _FAINTEST_LIGHT:
            return image
        # A lamp acts on the ground as well; lost or blurred pins and a reflection do not.
        far = abs(ground - factor * rest_ground) > max(_SAME_GROUND * ground, _LEVELS)
        if far and ground + contrast < _SATURATED:
            return image
        if factor > 1 and cover > _COVER * rest_cover:
            return image
        lit = rest_ground + (image.astype(np.float32) - ground) / np.float32(factor)
        levels: Images = np.rint(lit).clip(0, 255).astype(np.uint8)
        return levels

    @cached_property
    def _light(self) -> tuple[float, float, float]:
        return _light(self.rest_image)

    def displacements(self, images: Images) -> Array:
        """Return (N, 2 P) displacements of the pins, x of all before y of all, px."""
        return self.track(images)[0]

    def track(self, images: Images) -> tuple[Array, Flags]:
        """Return the (N, 2 P) ``displacements``, and (N, P) whether each pin is sure.

        Where pins crowd, a tracker may be one pin off. A pin nearby then finds no place, so pins
        around a pin that was not seen are doubtful.
        """
        tracks = self.tracker.track(images)
        moved = (tracks.xy - self.rest).transpose(0, 2, 1)
        sure = np.ones(tracks.seen.shape, dtype=np.bool_)
        for row in np.flatnonzero(~tracks.seen.all(axis=1)):
            sure[row] = ~self._around[:, ~tracks.seen[row]].any(axis=1)
        return moved.reshape(len(images), 2 * len(self.rest)), sure

    def retrack(self, images: Images, moved: Array) -> tuple[Array, Flags]:
        """Return displacements (N, 2 P) px of pins near ``moved``, and (N, P) whether each is seen.

        This tells crowded pins apart that ``track`` cannot.

        Args:
            images: (N, side, side) gray, in the light of the rest image.
            moved: (N, 2 P) approximate displacements, x of all pins before y of all, px.
        """
        xy = self.rest + moved.reshape(len(images), 2, -1).transpose(0, 2, 1)
        tracks = self.tracker.refit(images, xy)
        return (tracks.xy - self.rest).transpose(0, 2, 1).reshape(moved.shape), tracks.seen

    @cached_property
    def pitch(self) -> float:
        """Median distance of a pin at rest from its nearest neighbour, px."""
        distances = self._distances.copy()
        distances[np.diag_indices(len(distances))] = np.inf
        return float(np.median(distances.min(axis=1)))

    @cached_property
    def _distances(self) -> Array:
        """The (P, P) distances between pins at rest, px."""
        return np.asarray(np.hypot(*(self.rest[:, None] - self.rest).transpose(2, 0, 1)))

    @cached_property
    def _around(self) -> Flags:
        return self._distances < _DOUBTFUL * self.pitch


def _light(image: Images) -> tuple[float, float, float]:
    """Return the ground's grey level, the pins' level above it, and the share that pins cover."""
    ranks = [int(share * (image.size - 1)) for share in (_GROUND, _PINS)]
    ground, pins = np.partition(image, ranks, axis=None)[ranks].astype(float)
    contrast = max(pins - ground, 1.0)
    return ground, contrast, float(np.mean(image > ground + contrast / 2))
