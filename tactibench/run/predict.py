"""Predictions of a trained model for the test frames, one frame at a time.

They are kept under the identity of the whole run: a second store, or a run that was stopped while
it was timed, does not ask the model again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, Frame, PlatePose, Pose, Signal
from tactibench.errors import NotFiniteError, UserError
from tactibench.plugins.base import Model
from tactibench.records.answers import unpack_contacts, unpack_plates
from tactibench.records.files import read_checked_arrays, write_checked_arrays
from tactibench.records.store import Arrays

HeatMaps = npt.NDArray[np.float16]
Answers = list[Answer | None]
MAPS = "maps"


class NotFinitePredictionError(UserError, NotFiniteError):
    """A model predicted NaN or infinity."""


@dataclass(frozen=True)
class AnswerRules:
    """Limits of the answers of a model.

    Attributes:
        kind: "contacts" or "plate".
        max_contacts: at most so many a frame; None: any number.
        shape: (rows, columns) of heatmaps.
    """

    kind: str
    max_contacts: int | None
    shape: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Predictions:
    """Predictions for all test frames.

    Attributes:
        arrays: packed answers, as they are stored with a run.
        maps: (N, H, W) first heatmaps; None where the model shows none.
    """

    arrays: Arrays
    maps: npt.NDArray[np.float16] | None = None

    @property
    def map_arrays(self) -> Arrays:
        """Return the heatmaps as they are stored with a run; {} where there are none."""
        return {} if self.maps is None else {MAPS: self.maps}

    def answers(self, kind: str) -> list[Answer | None]:
        """Return the answers, "contacts" or "plate"."""
        unpack = unpack_plates if kind == "plate" else unpack_contacts
        return list(unpack(self.arrays))


def predict_frames(
    model: Model, frames: Sequence[Frame], rules: AnswerRules, advance: Callable[[int], None]
) -> tuple[Answers, HeatMaps | None]:
    """Return the answers at batch 1 in float32, in order, and (N, H, W) first heatmaps, if any.

    The model is given blinded frames.

    Raises:
        UserError: when the model answers something else than it declared.
    """
    answers: Answers = []
    heat: list[HeatMaps] = []
    for frame in frames:
        seen = [blinded(frame)]
        maps = model.maps(seen) if rules.kind == "contacts" else None
        if maps is None:
            predicted = model.predict(seen)
        else:
            _check_maps(np.asarray(maps), rules.shape)
            heat.append(np.asarray(maps)[0, 0].astype(np.float16))
            predicted = model.read_maps(maps)
        if len(predicted) != 1:
            raise UserError(
                f"the model gave {len(predicted)} answers for one frame; it must give one."
            )
        _check_answer(predicted[0], rules)
        answers.append(predicted[0])
        advance(1)
    return answers, np.stack(heat) if heat else None


def blinded(frame: Frame) -> Frame:
    """Return the frame as a model may see it at test time.

    Its pose is the truth, its time tells which press of a set it is, and a mapped signal knows its
    file: all three are left out.
    """
    signal = cast("Signal", np.array(frame.signal))
    return Frame(signal, 0.0, Pose(), frame.rest)


def cached_predictions(
    path: Path, weights_hash: str, predict: Callable[[], Predictions], *, fresh: bool
) -> Predictions:
    """Return the kept predictions of these very weights, or make and keep them.

    Args:
        path: of the file in the cache.
        weights_hash: of the model's weights; predictions of other weights are not taken.
        predict: asks the model.
        fresh: whether to ask the model in any case.
    """
    arrays = None if fresh else read_checked_arrays(path, weights_hash)
    if arrays is None:
        predictions = predict()
        write_checked_arrays(path, {**predictions.arrays, **predictions.map_arrays}, weights_hash)
        return predictions
    maps = arrays.pop(MAPS, None)
    return Predictions(arrays, maps)


def _check_answer(answer: Answer | None, rules: AnswerRules) -> None:
    if rules.kind == "plate":
        if answer is not None and not isinstance(answer, PlatePose):
            raise UserError(f"the model answered {type(answer).__name__} where PlatePose is asked.")
        if answer and not np.isfinite([answer.depth, answer.tilt, *(answer.std or ())]).all():
            raise NotFinitePredictionError(
                "the model answered a plate pose that is not finite; fix the model."
            )
        return
    if not isinstance(answer, Contacts):
        raise UserError(f"the model answered {type(answer).__name__} where Contacts is asked.")
    if rules.max_contacts is not None and len(answer) > rules.max_contacts:
        raise UserError(
            f"the model declares at most {rules.max_contacts} contacts per frame, but gave "
            f"{len(answer)}."
        )


def _check_maps(maps: npt.NDArray[Any], shape: tuple[int, int]) -> None:
    if maps.ndim != 4 or (len(maps), *maps.shape[2:]) != (1, *shape):
        raise UserError(
            f"the model gave maps of shape {maps.shape} for one frame; they must have the shape "
            f"(1, channels, {shape[0]}, {shape[1]})."
        )
    if not np.isfinite(maps).all():
        raise NotFinitePredictionError(
            "the model gave a map with a value that is not finite; fix the model."
        )
