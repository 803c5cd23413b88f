"""Asking a trained model about the test frames, one frame at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, Frame, PlatePose, Pose
from tactibench.errors import UserError
from tactibench.plugins.interfaces import MapsModel, Model

MAPS_BATCH = 32


def predict_all(
    model: Model,
    frames: Sequence[Frame],
    answer: str,
    max_contacts: int | None,
    advance: Callable[[int], None],
) -> list[Answer | None]:
    """Answers at batch 1 in float32, in order. The model is given blinded frames.

    Raises UserError when the model answers something else than it declared.
    """
    answers: list[Answer | None] = []
    for frame in frames:
        found = model.predict([blinded(frame)])
        if len(found) != 1:
            raise UserError(f"the model gave {len(found)} answers for one frame; it must give one.")
        answers.append(_checked(found[0], answer, max_contacts))
        advance(1)
    return answers


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
            raise UserError("the model answered a plate pose that is not finite; mend the model.")
        return found
    if not isinstance(found, Contacts):
        raise UserError(f"the model answered {type(found).__name__} where Contacts is asked.")
    if max_contacts is not None and len(found) > max_contacts:
        raise UserError(
            f"the model declares at most {max_contacts} contacts per frame, but gave {len(found)}."
        )
    return found


def predicted_maps(
    model: Model, frames: Sequence[Frame], shape: tuple[int, int]
) -> npt.NDArray[np.float16] | None:
    """(N, H, W) float16 first heatmap of every frame; None for a model without maps.

    Raises UserError for maps of another shape and for values that are not finite.
    """
    if not isinstance(model, MapsModel):
        return None
    out = np.empty((len(frames), *shape), dtype=np.float16)
    for start in range(0, len(frames), MAPS_BATCH):
        batch = [blinded(frame) for frame in frames[start : start + MAPS_BATCH]]
        maps = np.asarray(model.maps(batch))
        if maps.ndim != 4 or (len(maps), *maps.shape[2:]) != (len(batch), *shape):
            raise UserError(
                f"the model gave maps of shape {maps.shape} for {len(batch)} frames; they must "
                f"have the shape ({len(batch)}, channels, {shape[0]}, {shape[1]})."
            )
        out[start : start + MAPS_BATCH] = maps[:, 0]
    if not np.isfinite(out).all():
        raise UserError("the model gave a map with a value that is not finite; mend the model.")
    return out
