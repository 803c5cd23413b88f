"""Predictions of a trained model for the test frames, one frame at a time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, Frame, PlatePose, Pose, Signal, Sites
from tactibench.errors import NotFiniteError, UserError
from tactibench.plugins import Model, describe_method
from tactibench.records import Arrays, pack, round_answers
from tactibench.run.worker import WorkerError, WorkerModel

LONGEST_CAUSE = 200
"""Characters of a cause that are stored: a message may hold a whole array."""
HeatMaps = npt.NDArray[np.float16]
Answers = list[Answer | None]


class BadAnswerError(UserError):
    """A model answered something else than it must.

    Attributes:
        found: The sentence for a record. It does not name the source, whose path differs between
            machines.
    """

    def __init__(self, found: str, source: str = "the model") -> None:
        super().__init__(f"{found}; fix {source}.")
        self.found = f"{found}; fix the model."


class NotFinitePredictionError(BadAnswerError, NotFiniteError):
    """A model predicted NaN or infinity."""


@dataclass(frozen=True)
class AnswerRules:
    """Limits of the answers of a model.

    Attributes:
        kind: "contacts", "plate" or "sites".
        max_contacts: Most contacts of a frame; None for any number.
        shape: (rows, columns) of heatmaps.
        depth: Whether contacts must have depths: the truth knows them.
    """

    kind: str
    max_contacts: int | None
    shape: tuple[int, int]
    depth: bool = True


class Predictions(NamedTuple):
    """Predictions for all test frames, as they are stored with a run.

    Attributes:
        arrays: Packed and rounded answers, and the failures of the model where they are counted.
        maps: (N, H, W) first heatmaps, named "maps"; {} where the model shows none.
    """

    arrays: Arrays
    maps: Arrays

    @classmethod
    def of(cls, answers: Answers, heat: HeatMaps | None, kind: str) -> Predictions:
        """Return the predictions of a kind, "contacts", "plate" or "sites"."""
        return cls(round_answers(pack(answers, kind)), {} if heat is None else {"maps": heat})


def predict_frames(
    model: Model, frames: Sequence[Frame], rules: AnswerRules, advance: Callable[[int], None]
) -> tuple[Answers, HeatMaps | None]:
    """Return the answers at batch 1 in float32, in order, and (N, H, W) first heatmaps, if any.

    The model is given blinded frames.

    Args:
        model: The trained model.
        frames: N test frames.
        rules: Limits of the answers.
        advance: Function that is called after every frame.

    Raises:
        UserError: The model answers something else than it declared.
    """
    answers: Answers = []
    heat: list[HeatMaps] = []
    for predicted, maps, method in _raw_answers(model, frames, rules):
        if maps is not None:
            heat.append(maps[0, 0].astype(np.float16))
        answers.append(_checked_answer(predicted, rules, model, method))
        advance(1)
    if heat and len(heat) < len(frames):
        raise BadAnswerError(
            f"the model gave maps for {len(heat)} of {len(frames)} frames, but must give them for "
            "all or none",
            describe_method(model, "maps"),
        )
    return answers, np.stack(heat) if heat else None


def _raw_answers(
    model: Model, frames: Sequence[Frame], rules: AnswerRules
) -> Iterator[tuple[object, npt.NDArray[Any] | None, str]]:
    """Yield the list with the answer to each frame, its maps, and the method that gave it."""
    if isinstance(model, WorkerModel):
        for answer, first in model.answers(frames):
            maps = None if first is None else _checked_maps(first[np.newaxis], rules.shape, model)
            yield [answer], maps, "answers"
        return
    for frame in frames:
        seen = [blinded(frame)]
        maps = model.maps(seen) if rules.kind == "contacts" else None
        if maps is None:
            yield model.predict(seen), None, "predict"
        else:
            checked = _checked_maps(maps, rules.shape, model)
            yield model.read_maps(maps), checked, "read_maps"


def blinded(frame: Frame) -> Frame:
    """Return the frame as a model may see it at test time.

    Its pose and force are the truth, its time tells which press of a set it is, and a memory-mapped
    signal knows its file: all are left out.
    """
    signal = cast("Signal", np.array(frame.signal))
    return Frame(signal, 0.0, Pose(), frame.rest)


def _checked_answer(
    predicted: object, rules: AnswerRules, model: Model, method: str
) -> Answer | None:
    """Return the one answer of a list.

    Raises:
        UserError: The model gave no list with one answer, or its answer breaks the rules. The
            message names the method and its source.
    """
    source = describe_method(model, method)
    if not isinstance(predicted, (list, tuple)):
        raise BadAnswerError(
            f"the model gave a {type(predicted).__name__} where a list with one answer a frame is "
            "asked",
            source,
        )
    if len(predicted) != 1:
        raise BadAnswerError(
            f"the model gave {len(predicted)} answers for one frame, but must give one",
            source,
        )
    answer: object = predicted[0]
    asked: Any = {"contacts": Contacts, "plate": PlatePose, "sites": Sites}[rules.kind]
    if answer is None and asked is PlatePose:
        return None
    if not isinstance(answer, asked):
        raise BadAnswerError(
            f"the model answered {type(answer).__name__} where {asked.__name__} is asked",
            source,
        )
    # Contacts and named places refuse other such numbers when they are made.
    finite = True
    if isinstance(answer, PlatePose):
        finite = _is_finite(answer)
    elif isinstance(answer, Contacts):
        finite = answer.knows_depth or not rules.depth
    if not finite:
        raise NotFinitePredictionError(
            f"the model answered {type(answer).__name__} with a number that is not finite",
            source,
        )
    if (
        isinstance(answer, Contacts)
        and rules.max_contacts is not None
        and len(answer) > rules.max_contacts
    ):
        raise BadAnswerError(
            f"the model declares at most {rules.max_contacts} contacts per frame, but gave "
            f"{len(answer)}",
            source,
        )
    return cast("Answer", answer)


def _is_finite(pose: PlatePose) -> bool:
    return all(map(math.isfinite, (pose.depth, pose.tilt, *(pose.std or ()))))


def _checked_maps(maps: object, shape: tuple[int, int], model: Model) -> npt.NDArray[Any]:
    """Return the maps of one frame as an array, (1, channels, H, W).

    Raises:
        UserError: The maps have another shape or hold a value that is not finite. The message names
            ``maps`` and its source.
    """
    source = describe_method(model, "maps")
    array = np.asarray(maps)
    if array.ndim != 4 or array.shape[1] == 0 or (len(array), *array.shape[2:]) != (1, *shape):
        raise BadAnswerError(
            f"the model gave maps of shape {array.shape} for one frame; they must have the shape "
            f"(1, channels, {shape[0]}, {shape[1]})",
            source,
        )
    if not np.isfinite(array).all():
        raise NotFinitePredictionError(
            "the model gave a map with a value that is not finite",
            source,
        )
    return array


def failure_cause(error: BaseException) -> str:
    """Return type and message of an exception on one line: "ValueError: shapes do not fit"."""
    if isinstance(error, WorkerError):
        return error.cause[:LONGEST_CAUSE]
    message = error.found if isinstance(error, BadAnswerError) else str(error)
    text = " ".join(f"{type(error).__name__}: {message}".split())
    return "".join(sign for sign in text if sign.isprintable())[:LONGEST_CAUSE]
