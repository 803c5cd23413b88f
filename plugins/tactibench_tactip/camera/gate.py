"""Whether the frames of a press may be kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench import UserError
from tactibench.markers import Tracker
from tactibench_tactip.camera.driver import Shot
from tactibench_tactip.camera.source import Image
from tactibench_tactip.geometry.frames import Array
from tactibench_tactip.settings import SensorKeys

SATURATED = 250
MOST_SATURATED = 0.01
BRIGHTNESS = 0.10
"""Share by which the mean brightness may differ from that of the undeformed sensor."""
STILL = 1.5
"""How many times the noise between two frames at rest two frames of a press may differ."""
SURELY_MM = 0.5
"""Depth from which on a press must be seen."""


@dataclass(frozen=True, eq=False)
class Reference:
    """The undeformed sensor. mean: (H, W) grey levels. between: mean absolute difference of two
    frames in a row. change: of one frame from the mean, and its standard deviation. pins: that are
    seen."""

    mean: Array
    between: float
    change: float
    change_std: float
    pins: int

    @classmethod
    def of(cls, shots: Sequence[Shot]) -> Reference:
        images = np.stack([shot.image for shot in shots]).astype(np.float32)
        mean = images.mean(axis=0).astype(np.float64)
        between = [float(np.abs(b - a).mean()) for a, b in pairwise(images)]
        change = [_change(image, mean) for image in images]
        # The mean holds 1 / n of every frame, which makes each look closer to it than a new one.
        grow = (1.0 + 1.0 / len(images)) / (1.0 - 1.0 / len(images))
        changed = float(np.mean(change)) * grow**0.5
        return cls(
            mean,
            float(np.mean(between)),
            changed,
            float(np.std(change)),
            count_pins(np.rint(mean).astype(np.uint8)),
        )

    @property
    def brightness(self) -> float:
        return float(self.mean.mean())

    @property
    def image(self) -> Image:
        """(H, W) uint8."""
        return np.rint(self.mean).astype(np.uint8)

    def change_of(self, image: Image) -> float:
        """Mean absolute difference from the undeformed sensor, grey levels; what all pixels
        changed alike, as light does, is not counted."""
        return _change(image, self.mean)

    @property
    def threshold(self) -> float:
        """Change that noise does not make: 5 of its standard deviations, and a little for LEDs."""
        return self.change + 5.0 * self.change_std + 0.02


@dataclass(frozen=True, eq=False)
class Judged:
    """What the frames of a press are. reason: why they cannot be kept, "" when they can. image:
    (H, W) median. t_ns: of the middle frame. pins: -1 where nobody counts."""

    reason: str
    image: Image
    t_ns: int
    brightness: float
    contrast: float
    saturated: float
    pins: int


def judge(shots: Sequence[Shot], reference: Reference, keys: SensorKeys, depth_mm: float) -> Judged:
    """Look at the frames of one press in a row; depth_mm: what the press is."""
    image = np.median(np.stack([shot.image for shot in shots]), axis=0).astype(np.uint8)
    pins = -1 if keys.pins is None else count_pins(image)
    saturated = float((image >= SATURATED).mean())
    saturated_at_rest = float((reference.mean >= SATURATED).mean())
    judged = Judged(
        "",
        image,
        shots[len(shots) // 2].t_ns,
        float(image.mean()),
        float(image.std()),
        saturated,
        pins,
    )
    more = saturated - saturated_at_rest
    return replace(judged, reason=_reason(shots, judged, more, reference, keys, depth_mm))


def _reason(
    shots: Sequence[Shot],
    judged: Judged,
    saturated: float,
    reference: Reference,
    keys: SensorKeys,
    depth_mm: float,
) -> str:
    if abs(judged.brightness - reference.brightness) > BRIGHTNESS * max(1.0, reference.brightness):
        return (
            f"brightness {judged.brightness:.1f}, at rest {reference.brightness:.1f}: the light "
            "or the exposure changed"
        )
    if saturated > MOST_SATURATED:
        return f"{saturated:.1%} of the pixels are saturated"
    if keys.pins is not None and abs(judged.pins - keys.pins) > keys.pins_tolerance:
        return f"{judged.pins} pins are seen, sensor.pins is {keys.pins}"
    between = [
        float(np.abs(b.image.astype(np.float32) - a.image).mean()) for a, b in pairwise(shots)
    ]
    if reference.between > 0 and max(between) == 0:
        return "frames in a row are the same to the last bit: the camera repeats itself"
    if max(between) > STILL * reference.between + 0.2:
        return f"frames in a row differ by {max(between):.2f} grey levels: something still moves"
    if depth_mm >= SURELY_MM and reference.change_of(judged.image) < seen_change(reference):
        return f"no contact is seen at {depth_mm:.1f} mm"
    return ""


def _change(image: npt.NDArray[Any], mean: Array) -> float:
    difference = image - mean
    return float(np.abs(difference - difference.mean()).mean())


def seen_change(reference: Reference) -> float:
    """Change of a median of frames that a press of SURELY_MM exceeds: a median has less noise than
    a frame."""
    return reference.change


def count_pins(image: Image) -> int:
    """Bright blobs that may be pins; 0 where nothing can be found."""
    try:
        return len(Tracker(image, refine="centroid").rest)
    except UserError:
        return 0
