"""Asking a trained model about the test frames, one frame at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, Frame, PlatePose, Pose
from tactibench.errors import UserError
from tactibench.plugins.base import Model

HeatMaps = npt.NDArray[np.float16]


class NotFiniteError(UserError):
    """The model answered with NaN or infinity."""


def predict_all(
    model: Model,
    frames: Sequence[Frame],
    answer: str,
    max_contacts: int | None,
    shape: tuple[int, int],
    advance: Callable[[int], None],
) -> tuple[list[Answer | None], HeatMaps | None]:
    """Answers at batch 1 in float32, in order, and (N, H, W) first heatmaps where there are any.

    The model is given blinded frames; ``shape`` is that of its maps.

    Raises UserError when the model answers something else than it declared.
    """
    answers: list[Answer | None] = []
    heat: list[HeatMaps] = []
    for frame in frames:
        seen = [blinded(frame)]
        maps = model.maps(seen) if answer == "contacts" else None
        if maps is None:
            found = model.predict(seen)
        else:
            maps = np.asarray(maps)
            heat.append(_checked_maps(maps, shape)[0, 0].astype(np.float16))
            found = model.read_maps(maps)
        if len(found) != 1:
            raise UserError(f"the model gave {len(found)} answers for one frame; it must give one.")
        answers.append(_checked(found[0], answer, max_contacts))
        advance(1)
    return answers, np.stack(heat) if heat else None


def blinded(frame: Frame) -> Frame:
    """The frame as a model may see it at test time.

    Its pose is the truth, its time tells which press of a set it is, and a mapped image knows its
    file: all three stay here.
    """
    return Frame(np.array(frame.image), 0.0, Pose(), frame.rest)


def _checked(found: Answer | None, answer: str, max_contacts: int | None) -> Answer | None:
    if answer == "plate":
        if found is None:
            return None
        if not isinstance(found, PlatePose):
            raise UserError(f"the model answered {type(found).__name__} where PlatePose is asked.")
        if not np.isfinite([found.depth, found.tilt, *(found.std or ())]).all():
            text = "the model answered a plate pose that is not finite; mend the model."
            raise NotFiniteError(text)
        return found
    if not isinstance(found, Contacts):
        raise UserError(f"the model answered {type(found).__name__} where Contacts is asked.")
    if max_contacts is not None and len(found) > max_contacts:
        raise UserError(
            f"the model declares at most {max_contacts} contacts per frame, but gave {len(found)}."
        )
    return found


def _checked_maps(maps: npt.NDArray[Any], shape: tuple[int, int]) -> npt.NDArray[Any]:
    if maps.ndim != 4 or (len(maps), *maps.shape[2:]) != (1, *shape):
        raise UserError(
            f"the model gave maps of shape {maps.shape} for one frame; they must have the shape "
            f"(1, channels, {shape[0]}, {shape[1]})."
        )
    if not np.isfinite(maps).all():
        text = "the model gave a map with a value that is not finite; mend the model."
        raise NotFiniteError(text)
    return maps
