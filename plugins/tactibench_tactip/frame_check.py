"""The undeformed sensor as a reference, and the check of a press's frames against it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench import UserError
from tactibench.markers import Tracker
from tactibench_tactip.camera import CameraFrame, Image
from tactibench_tactip.poses import Array
from tactibench_tactip.settings import SensorSettings

SATURATED = 250
"""Grey level from which a pixel counts as saturated: noise keeps full ones a little below 255."""
MOST_SATURATED = 0.01
"""Share of the frame that may saturate under a press: more is glare, and pins in it are lost."""
BRIGHTNESS = 0.10
"""Share by which the mean brightness may differ from that of the undeformed sensor."""
MOTION = 1.5
"""Factor on the difference of two frames at rest by which two frames of a press may differ."""
SEEN_MM = 0.5
"""Depth from which on a press must be visible in the frame."""
RELAXED = 0.3
"""Share of a press's change that a frame after it may still show."""
RELAXED_LEVELS = 0.3
"""Least value of that limit, grey levels, where the press itself changed little."""


@dataclass(frozen=True, eq=False)
class Reference:
    """The undeformed sensor.

    Attributes:
        mean: (H, W) mean of the frames, grey levels.
        between: Mean absolute difference of two frames in a row.
        change: Mean absolute difference of one frame from the mean.
        change_std: Standard deviation of the change over frames.
        pins: Number of pins in the mean.
    """

    mean: Array
    between: float
    change: float
    change_std: float
    pins: int

    @classmethod
    def of(cls, frames: Sequence[CameraFrame]) -> Reference:
        """Return the reference of frames of the undeformed sensor."""
        images = np.stack([frame.image for frame in frames]).astype(np.float32)
        mean = images.mean(axis=0).astype(np.float64)
        changes = [_change(image, mean) for image in images]
        # The mean holds 1 / n of every frame, so that each looks closer to it than a new frame.
        grow = (1.0 + 1.0 / len(images)) / (1.0 - 1.0 / len(images))
        return cls(
            mean=mean,
            between=float(np.mean([float(np.abs(b - a).mean()) for a, b in pairwise(images)])),
            change=float(np.mean(changes)) * grow**0.5,
            change_std=float(np.std(changes)),
            pins=count_pins(np.rint(mean).astype(np.uint8)),
        )

    @property
    def brightness(self) -> float:
        """Mean grey level."""
        return float(self.mean.mean())

    @property
    def image(self) -> Image:
        """The mean as (H, W) uint8."""
        return np.rint(self.mean).astype(np.uint8)

    @property
    def threshold(self) -> float:
        """Change that noise does not reach: its mean, 5 deviations, and a little for LEDs."""
        return self.change + 5.0 * self.change_std + 0.02

    def change_of(self, image: Image) -> float:
        """Return the mean absolute difference from the undeformed sensor, grey levels.

        A change that all pixels share, as light makes it, is not counted.
        """
        return _change(image, self.mean)

    def change_after(self, press: Image) -> float:
        """Return the largest change, grey levels, of a frame that no longer shows a press."""
        share = RELAXED * (self.change_of(press) - self.change)
        return self.change + max(RELAXED_LEVELS, share)

    def pins_differ(self, sensor: SensorSettings) -> bool:
        """Return whether the count of pins is not the configuration's."""
        return sensor.pins is not None and abs(self.pins - sensor.pins) > sensor.pins_tolerance


@dataclass(frozen=True, eq=False)
class FrameCheck:
    """The frames of one press, joined and checked.

    Attributes:
        reason: Why they cannot be used; "" where they can.
        image: (H, W) median.
        t_ns: Time of the middle frame.
        brightness: Mean of the image, grey levels.
        contrast: Standard deviation of the image, grey levels.
        saturated: Share of saturated pixels.
        pins: Number of pins; -1 where they are not counted.
    """

    reason: str
    image: Image
    t_ns: int
    brightness: float
    contrast: float
    saturated: float
    pins: int


def check_frames(
    frames: Sequence[CameraFrame], reference: Reference, sensor: SensorSettings, depth_mm: float
) -> FrameCheck:
    """Return the frames of one press, joined and checked.

    Args:
        frames: Frames in a row.
        reference: The undeformed sensor.
        sensor: Configuration of the sensor.
        depth_mm: Depth of the press.
    """
    image = np.median(np.stack([frame.image for frame in frames]), axis=0).astype(np.uint8)
    check = FrameCheck(
        reason="",
        image=image,
        t_ns=frames[len(frames) // 2].t_ns,
        brightness=float(image.mean()),
        contrast=float(image.std()),
        saturated=float((image >= SATURATED).mean()),
        pins=-1 if sensor.pins is None else count_pins(image),
    )
    return replace(check, reason=_reason(frames, check, reference, sensor, depth_mm))


def is_other_light(brightness: float, at_rest: float) -> bool:
    """Return whether two mean brightnesses, grey levels, differ by more than a press explains."""
    return abs(brightness - at_rest) > BRIGHTNESS * max(1.0, at_rest)


def _reason(
    frames: Sequence[CameraFrame],
    check: FrameCheck,
    reference: Reference,
    sensor: SensorSettings,
    depth_mm: float,
) -> str:
    if is_other_light(check.brightness, reference.brightness):
        return (
            f"brightness {check.brightness:.1f}, at rest {reference.brightness:.1f}: the light "
            "or the exposure changed"
        )
    saturated = check.saturated - float((reference.mean >= SATURATED).mean())
    if saturated > MOST_SATURATED:
        return f"{saturated:.1%} of the pixels are saturated"
    if sensor.pins is not None and abs(check.pins - sensor.pins) > sensor.pins_tolerance:
        return f"{check.pins} pins are seen, sensor.pins is {sensor.pins}"
    between = max(
        float(np.abs(b.image.astype(np.float32) - a.image).mean()) for a, b in pairwise(frames)
    )
    if reference.between > 0 and between == 0:
        return "frames in a row are the same to the last bit: the camera repeats itself"
    if between > MOTION * reference.between + 0.2:
        return f"frames in a row differ by {between:.2f} grey levels: something still moves"
    # The median of a press has less noise than one frame, to which this change belongs.
    if depth_mm >= SEEN_MM and reference.change_of(check.image) < reference.change:
        return f"no contact is seen at {depth_mm:.1f} mm"
    return ""


def _change(image: npt.NDArray[Any], mean: Array) -> float:
    difference = image - mean
    return float(np.abs(difference - difference.mean()).mean())


def count_pins(image: Image) -> int:
    """Return the number of bright blobs that may be pins; 0 where there are none."""
    try:
        return len(Tracker(image, refine="centroid").rest)
    except UserError:
        return 0
