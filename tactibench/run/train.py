"""Training: frames of a plan are opened or made, and weights are loaded or trained."""

from __future__ import annotations

from functools import partial

from tactibench.frames import FrameSet, Presses, true_answers
from tactibench.plugins import Model
from tactibench.run.plan import RunPlan
from tactibench.run.reporter import Reporter
from tactibench.run.weights import Examples, TrainedWeights, trained_weights


def train_model(plan: RunPlan, reporter: Reporter) -> tuple[Model, TrainedWeights]:
    """Return the model of a plan with its weights, trained where they are not in the cache.

    Interrupted training is continued by the same call.
    """
    model = plan.components.build_model(plan.context())
    with reporter.training() as progress:
        examples = partial(_examples, plan, reporter)
        weights = trained_weights(plan.weights, model, examples, progress)
    return model, weights


def open_frames(frames: FrameSet, reporter: Reporter) -> Presses:
    """Return the frames of one set, made where they are not in the cache."""
    verb = "open" if frames.cached else "generate"
    with reporter.task(f"{verb} {frames.name} ({frames.role})", len(frames.scenes)) as advance:
        return frames.open(advance)


def _examples(plan: RunPlan, reporter: Reporter, role: str) -> Examples:
    sets = plan.frames.fit if role == "fit" else plan.frames.validation
    opened = [open_frames(frames, reporter) for frames in sets]
    frames = [frame for presses in opened for frame in presses.frames]
    return frames, true_answers(plan.spec, opened)
