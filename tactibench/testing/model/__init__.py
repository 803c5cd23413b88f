"""What every model must hold."""

from __future__ import annotations

from tactibench.testing.model import answers, frames, training
from tactibench.testing.model.subject import ModelSubject
from tactibench.testing.property import Property

PROPERTIES = tuple(
    Property.of(function)
    for function in (
        training.target,
        training.parameters,
        training.fit,
        answers.shapes,
        answers.answered,
        answers.empty,
        answers.batch,
        training.seed,
        training.save_load,
        training.damaged_weights,
        training.input_unchanged,
        answers.truth_hidden,
        frames.frame_size,
        frames.float_frame,
        frames.nan_frame,
        answers.every_answer,
        answers.several,
        answers.maps,
        answers.stages,
    )
)

__all__ = ["PROPERTIES", "ModelSubject"]
