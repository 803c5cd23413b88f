"""Frames that are not as those the model was trained on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Frame
from tactibench.errors import UserError, describe_exception
from tactibench.images import resized
from tactibench.testing.model.subject import ModelSubject, difference
from tactibench.testing.property import Failed, refused, require

SIZES = ((96, 96), (64, 80), (200, 160))
CLOSE = 0.05
"""mm by which answers to the same picture in another form may differ."""


def frame_size(subject: ModelSubject) -> None:
    """Frames of any other size, grey or colour, are answered, or refused with a sentence."""
    frame = subject.seen.frames[0]
    for shape in SIZES:
        other = _with(frame, partial(_resized, shape=shape))
        _answered_or_refused(subject, [other], f"a frame of {shape[0]} x {shape[1]} px")
    colour = _with(frame, _coloured)
    _answered_or_refused(subject, [colour], f"a frame of shape {colour.image.shape}")


def float_frame(subject: ModelSubject) -> None:
    """Frames of floats 0..255 are answered as the same ones of bytes are, or refused."""
    floats = [_with(frame, lambda image: image.astype(np.float32)) for frame in subject.seen.frames]
    answers = _answered_or_refused(subject, floats, "frames of float32 values 0..255")
    if answers is not None:
        away = difference(answers, subject.answers)
        require(away <= CLOSE, f"answers differ by {away:.3g} from those to the same bytes")


def nan_frame(subject: ModelSubject) -> None:
    """A frame with a NaN in it is refused with a sentence."""
    model = subject.trained()
    image: npt.NDArray[Any] = subject.seen.frames[0].image.astype(np.float32)
    image[3, 4] = np.nan
    with refused("a frame with a NaN in it"):
        model.predict([replace(subject.seen.frames[0], image=image)])


def _with(frame: Frame, change: Callable[[npt.NDArray[Any]], npt.NDArray[Any]]) -> Frame:
    """The frame with image and rest image changed alike."""
    rest = None if frame.rest is None else change(frame.rest)
    return replace(frame, image=change(frame.image), rest=rest)


def _resized(image: npt.NDArray[Any], shape: tuple[int, int]) -> npt.NDArray[Any]:
    """Grey, of another shape."""
    return resized(np.asarray(image[..., 1] if image.ndim == 3 else image), shape)


def _coloured(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """RGB of a grey image, grey of an RGB one."""
    return image[..., 1].copy() if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)


def _answered_or_refused(
    subject: ModelSubject, frames: list[Frame], what: str
) -> list[Answer | None] | None:
    """The answers; None: refused in words. Raises Failed for anything else."""
    model = subject.trained()
    try:
        return subject.ask(model, frames)
    except UserError as error:
        require(str(error).strip(), f"{what} was refused without a word")
        return None
    except Failed:
        raise
    except Exception as error:
        raise Failed(f"{what} raised {describe_exception(error)} instead of a UserError") from error
