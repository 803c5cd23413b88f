"""Labelled presses of a tested sensor: a check before a model adapts to them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactibench.contacts import Answer, Contacts, Frame, PlatePose
from tactibench.errors import UserError
from tactibench.plugins import ModelContext

DEEPEST = 1.5
"""Depths up to this multiple of the deepest press are accepted: a tip may end a little deeper than
asked. Labels in another unit than mm are at least ten times off."""
SHALLOWEST = 0.02
"""Labels whose deepest is below this share of the deepest press are not in mm."""


def check_labelled(
    frames: Sequence[Frame], truth: Sequence[Answer], tested: Frame, context: ModelContext
) -> None:
    """Refuse labelled presses that would teach a model something wrong.

    Args:
        frames: Frames of the tested sensor.
        truth: Label of every frame.
        tested: A frame of the test.
        context: Kind of answer, grid and largest depth of the model.

    Raises:
        UserError: There is no press, a label is missing, a frame is of another sensor, or a label
            is outside of the sensor or in another unit than millimetres and degrees.
    """
    if not len(frames) or len(frames) != len(truth):
        raise UserError(
            f"there are {len(frames)} labelled frames and {len(truth)} labels; a model adapts to "
            "one press or more, each with its label."
        )
    for number, frame in enumerate(frames, 1):
        if not _same_rest(frame, tested):
            raise UserError(
                f"labelled frame {number} of {len(frames)} has another rest frame than the test "
                "frames, so it is of another sensor; show presses of the tested one."
            )
    for number, answer in enumerate(truth, 1):
        if wrong := _out_of_range(answer, context):
            raise UserError(
                f"label {number} of {len(truth)} says {wrong}; labels are in mm and degrees, "
                "origin at the apex."
            )
    deepest = max((depth for answer in truth for depth in _depths(answer)), default=np.inf)
    if deepest < SHALLOWEST * context.max_depth:
        raise UserError(
            f"the deepest of {len(truth)} labels is {deepest:g} mm, where presses are up to "
            f"{context.max_depth:g} mm deep; labels are in mm, not in m."
        )


def _same_rest(frame: Frame, other: Frame) -> bool:
    if frame.rest is None or other.rest is None:
        return frame.rest is other.rest
    return frame.rest is other.rest or np.array_equal(frame.rest, other.rest)


def _depths(answer: Answer) -> list[float]:
    return [answer.depth] if isinstance(answer, PlatePose) else answer.depth.tolist()


def _out_of_range(answer: Answer, context: ModelContext) -> str:
    """Return the number that no press can have, in words; "" for a label that may be true."""
    for depth in _depths(answer):
        if not abs(depth) <= DEEPEST * context.max_depth:
            return f"depth {depth:g}, but presses are up to {context.max_depth:g} mm deep"
    if isinstance(answer, Contacts):
        x, y = context.grid.axes()
        for place in answer.xy.tolist():
            if (np.abs(place) > [np.abs(x).max(), np.abs(y).max()]).any():
                return f"({place[0]:g}, {place[1]:g}), which is outside of the sensor"
    elif not abs(answer.tilt) <= 90:
        return f"tilt {answer.tilt:g}, but a plate tilts by less than 90 degrees"
    return ""
