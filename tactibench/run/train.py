"""A trained model for a plan: its frames opened or made, its weights loaded or learned."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Protocol

from tactibench.contacts import Answer, Frame
from tactibench.frames.presses import Presses
from tactibench.frames.source import Wanted
from tactibench.plugins.base import Model, Progress
from tactibench.run.plan import RunPlan
from tactibench.run.truth import true_answers
from tactibench.run.weights import Examples, Trained, trained_weights


class Reporter(Protocol):
    """Shows long work. ``task`` gives a function that is told of finished items."""

    def task(self, title: str, total: int) -> AbstractContextManager[Callable[[int], None]]: ...

    def training(self) -> AbstractContextManager[Progress]: ...


def trained_model(plan: RunPlan, reporter: Reporter) -> tuple[Model, Trained]:
    """The model of a plan with its weights, trained where they are not in the cache.

    Interrupted training is continued by the same call.
    """
    model = plan.parts.build_model(plan.context())
    with reporter.training() as progress:
        trained = trained_weights(
            plan.weights, model, lambda role: _examples(plan, role, reporter), progress
        )
    return model, trained


def open_frames(wanted: Wanted, reporter: Reporter) -> Presses:
    """The frames of one set, made where they are not in the cache."""
    verb = "open" if wanted.cached else "generate"
    with reporter.task(f"{verb} {wanted.name} ({wanted.role})", len(wanted.scenes)) as advance:
        return wanted.open(advance)


def _examples(plan: RunPlan, role: str, reporter: Reporter) -> Examples:
    frames: list[Frame] = []
    truth: list[Answer] = []
    for wanted in plan.frames.fit if role == "fit" else plan.frames.validation:
        presses = open_frames(wanted, reporter)
        frames += presses.frames
        truth += true_answers(plan.protocol.keys, [presses])
    return frames, truth
