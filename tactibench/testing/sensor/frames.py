"""What a sensor's frames are, and that they mean what was pressed."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tactibench.contacts import Frame
from tactibench.errors import UserError
from tactibench.testing.property import NotApplicable, require
from tactibench.testing.sensor.subject import SensorSubject, change, image, middle, tip

ASIDE = 3.0
"""mm to either side of the apex at which the direction of a contact is looked at."""


def frames(subject: SensorSubject) -> None:
    """A press gives a frame of bytes, (H, W) or (H, W, 3), of one shape, with the pose pressed."""
    found = subject.pressed(*subject.scenes)
    for frame, scene in zip(found, subject.scenes, strict=True):
        require(isinstance(frame, Frame), f"press gave a {type(frame).__name__}, no Frame")
        require(frame.image.dtype == np.uint8, f"the image holds {frame.image.dtype}, no uint8")
        shape = frame.image.shape
        good = len(shape) == 2 or (len(shape) == 3 and shape[2] == 3)
        require(good and frame.image.size, f"an image of shape {shape}")
        require(shape == found[0].image.shape, f"shapes {found[0].image.shape} and {shape}")
        if frame.rest is not None:
            require(frame.rest.shape == shape, f"rest {frame.rest.shape}, image {shape}")
        if subject.spec.origin == "simulated":
            require(frame.pose == scene.pose, f"{scene.pose} was pressed, {frame.pose} is said")
    images = [frame.image for frame in found]
    require(
        not all(np.array_equal(one, images[0]) for one in images[1:]),
        f"{len(images)} different presses gave the same image",
    )


def rest_frame(subject: SensorSubject) -> None:
    """The rest frame is of the shape of a press, has depth 0, and a press does not change it."""
    with subject.build() as sensor:
        try:
            before = sensor.rest()
        except UserError as error:
            raise NotApplicable(f"it has no rest frame ({error})") from None
        press = sensor.press(subject.scenes[0])
        after = sensor.rest()
    shape = press.image.shape
    require(before.image.dtype == np.uint8, f"the image holds {before.image.dtype}, no uint8")
    require(before.image.shape == shape, f"rest {before.image.shape}, press {shape}")
    require(before.pose.depth <= 0, f"the rest frame has a depth of {before.pose.depth} mm")
    drift, moved = change(after, before).mean(), change(press, before).mean()
    require(drift < 0.5 * moved, f"after a press, rest differs by {drift:.3g}, a press {moved:.3g}")


def deeper(subject: SensorSubject) -> None:
    """Depths are mm: at the apex, a tip pressed deeper changes the frame more."""
    subject.must_press_anything()
    space = subject.keys.workspace
    depths = np.linspace(max(1.0, space.depth_min_mm), min(5.0, space.depth_max_mm), 4)
    with subject.build() as sensor:
        rest = sensor.rest()
        levels = [_moved(sensor.press(tip(0, 0, float(depth))), rest) for depth in depths]
    shown = ", ".join(
        f"{level:.3g} at {depth:.2g} mm" for level, depth in zip(levels, depths, strict=True)
    )
    require(all(a < b for a, b in pairwise(levels)), f"mean change in grey levels: {shown}")


def direction(subject: SensorSubject) -> None:
    """x points right and y down: a contact 3 mm that way changes the frame on that side."""
    subject.must_press_anything()
    depth = 0.5 * (subject.keys.workspace.depth_min_mm + subject.keys.workspace.depth_max_mm)
    with subject.build() as sensor:
        rest = sensor.rest()
        left, right, up, down = (
            middle(change(sensor.press(tip(x, y, depth)), rest))
            for x, y in ((-ASIDE, 0), (ASIDE, 0), (0, -ASIDE), (0, ASIDE))
        )
    for axis, name, low, high in ((0, "x right", left, right), (1, "y down", up, down)):
        along, across = high[axis] - low[axis], high[1 - axis] - low[1 - axis]
        found = f"6 mm along {name} moved the change by {along:.1f} px, and {across:.1f} px across"
        require(along > 1.0 and along > 2 * abs(across), found)


def timestamps(subject: SensorSubject) -> None:
    """The time of every press is finite and later than that of the press before."""
    times = [frame.timestamp for frame in subject.pressed(*subject.scenes)]
    require(np.isfinite(times).all(), f"times {times} s")
    require(all(a < b for a, b in pairwise(times)), f"times {times} s do not increase")


def _moved(frame: Frame, rest: Frame) -> float:
    return float(np.abs(image(frame) - image(rest)).mean())
