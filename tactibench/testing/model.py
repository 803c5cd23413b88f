"""The properties of a model: every public function is a property and gives it its name."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Contacts, Frame, Sites
from tactibench.errors import UserError
from tactibench.plugins import IMAGE, FitReport
from tactibench.superposition import REACH_MM, Refinement
from tactibench.testing.subjects import (
    FIT,
    SEED,
    VALIDATION,
    Failed,
    ModelSubject,
    NotApplicable,
    as_json,
    changed_images,
    check_parameters,
    difference,
    must_refuse,
    require,
    writable,
)

BATCH = 8
"""Frames that are answered together."""
SHOWN = 10
"""Labelled frames that a model adapts to."""
EXACT = 1e-6
"""Largest difference, in mm, deg and score, between answers of the same weights."""
NEAR = 0.05
"""Presses are some mm from the axis or some mm deep: answers that are all smaller than this, in mm,
are in metres."""
CLOSE = 1e-3
"""Largest difference where only the order of additions differs."""

Image = npt.NDArray[Any]


def target(subject: ModelSubject) -> None:
    """The class behind the spec loads, inherits from tactibench.Model, and builds."""
    subject.build()


def parameters(subject: ModelSubject) -> None:
    """A model builds with every bound and choice of a parameter, or refuses the value in words."""
    check_parameters(subject.spec, subject.values, subject.build)


def fit(subject: ModelSubject) -> None:
    """Training on 40 frames ends, and gives a FitReport that can be written as JSON."""
    report: object = subject.report()
    if not isinstance(report, FitReport):
        raise Failed(f"fit gave a {type(report).__name__}")
    try:
        json.dumps(asdict(report), allow_nan=False, default=lambda value: value.item())
    except (ValueError, TypeError, AttributeError) as error:
        raise Failed(f"the report cannot be written as JSON: {error}") from error


def shapes(subject: ModelSubject) -> None:
    """One answer for every frame, of the declared kind, finite, in mm, of at most max_contacts."""
    answered = [a for a in subject.answers if isinstance(a, Contacts) and len(a)]
    for answer in answered:
        require(np.abs(answer.xy).max() < 1e3, f"a contact at {answer.xy[0]} mm; xy is in mm")
    far = [max(np.abs(a.xy).max(), np.nan_to_num(a.depth).max()) for a in answered]
    require(max(far, default=NEAR) >= NEAR, f"all xy and depths are below {NEAR}; they are in mm")


def finds_contacts(subject: ModelSubject) -> None:
    """After training, some frames are answered with a contact, so that answers can be compared."""
    if subject.answer_kind == "plate":
        raise NotApplicable("plate poses are asked for")
    count = sum(
        answer.count if isinstance(answer, Sites) else len(answer)
        for answer in subject.answers
        if isinstance(answer, Contacts | Sites)
    )
    require(
        count,
        f"no contact in {len(subject.answers)} answers after training with "
        f"{dict(subject.values) or 'no parameters'}; where that is too short, give another "
        "parameter, such as --param model.epochs=40",
    )


def empty(subject: ModelSubject) -> None:
    """No frames give no answers, and a frame in which nothing is touched gives an allowed one."""
    model = subject.trained()
    subject.predict(model, [])
    rest = subject.rest()
    subject.predict(model, [replace(rest, rest=rest.signal)])


def batch(subject: ModelSubject) -> None:
    """A frame is answered alike again, alone and among seven others, to within 0.001 mm."""
    model, frames = subject.trained(), subject.test_examples.frames[:BATCH]
    together = subject.predict(model, frames)
    gap = difference(subject.predict(model, frames), together)
    require(gap <= EXACT, f"a second time, answers differ by {gap:.3g}")
    alone = [subject.predict(model, [frame])[0] for frame in frames]
    gap = difference(alone, together)
    require(gap <= CLOSE, f"answers differ by {gap:.3g}")
    reversed_order = subject.predict(model, frames[::-1])[::-1]
    gap = difference(reversed_order, together)
    require(gap <= CLOSE, f"in another order, answers differ by {gap:.3g}")


def sensors(subject: ModelSubject) -> None:
    """Frames of two sensors, each with its own rest frame, are answered alike alone and mixed."""
    if subject.signal != IMAGE:
        raise NotApplicable("its frames are no images")

    def moved(image: Image) -> Image:
        return np.roll(image, 2, axis=1)

    frames = [
        _with_images(frame, moved) if row % 2 else frame
        for row, frame in enumerate(subject.test_examples.frames[:BATCH])
    ]
    try:
        together = subject.predict(subject.trained(), frames)
    except UserError:  # a camera that was moved may be refused
        return
    alone = [subject.predict(subject.trained(), [frame])[0] for frame in frames]
    gap = difference(alone, together)
    require(gap <= CLOSE, f"answers differ by {gap:.3g}")


def sessions(subject: ModelSubject) -> None:
    """Named places are told alike in a session that no training saw."""
    if subject.answer_kind != "sites":
        raise NotApplicable("no named places are asked for")
    frames = [replace(frame, session="another day") for frame in subject.test_examples.frames]
    gap = difference(subject.predict(subject.trained(), frames), subject.answers)
    require(gap <= CLOSE, f"probabilities differ by {gap:.3g}")


def seed(subject: ModelSubject) -> None:
    """Trainings from equal generator states answer alike, one of them with checkpoints kept."""
    model, _ = subject.trained_again
    gap = difference(subject.predict(model, subject.test_examples.frames), subject.answers)
    require(gap <= EXACT, f"answers differ by {gap:.3g}; is a global generator used?")


def deterministic(subject: ModelSubject) -> None:
    """A model that says that nothing is drawn saves the same weights after another seed."""
    if not subject.spec.deterministic:
        raise NotApplicable("it does not say so")
    other = subject.build()
    subject.fit(other, seed=SEED + 1)
    saved = []
    for model in (subject.trained(), other):
        with TemporaryDirectory() as name:
            model.save(Path(name))
            paths = sorted(path for path in Path(name).rglob("*") if path.is_file())
            saved.append([(path.name, path.read_bytes()) for path in paths])
    require(saved[0] == saved[1], "the weights of two seeds differ")


def save_load(subject: ModelSubject) -> None:
    """Weights saved into an empty folder answer alike when a new model has loaded them."""
    model = subject.build()
    with TemporaryDirectory() as name:
        folder = Path(name)
        subject.trained().save(folder)
        require(any(p.is_file() for p in folder.rglob("*")), "nothing was written into the folder")
        model.load(folder)
    gap = difference(subject.predict(model, subject.test_examples.frames), subject.answers)
    require(gap <= EXACT, f"answers differ by {gap:.3g}")


def input_unchanged(subject: ModelSubject) -> None:
    """Training and predicting leave frames and truth as they were."""
    model, changed = subject.trained_again
    require(not changed, f"fit changed {changed}")
    before = subject.test_examples.frames
    frames = [writable(frame) for frame in before]
    model.predict(frames)
    changed = changed_images(before, frames)
    require(not changed, f"predict changed {changed}")


def nan_frame(subject: ModelSubject) -> None:
    """A frame with a NaN in it is refused with a sentence."""
    model, frame = subject.trained(), subject.test_examples.frames[0]
    signal = frame.signal.astype(np.float32)
    signal[tuple(side // 2 for side in signal.shape)] = np.nan  # a model may ignore the border
    with must_refuse("a frame with a NaN in it"):
        model.predict([replace(frame, signal=signal)])


def maps(subject: ModelSubject) -> None:
    """The shown maps are (N, C, H, W) of the grid and finite, and read_maps gives the answers."""
    model = subject.trained()
    if subject.answer_kind != "contacts":
        raise NotApplicable("a run asks for maps of contacts only")
    frames = subject.test_examples.frames
    given = model.maps(list(frames))
    if given is None:
        raise NotApplicable("the model shows no maps")
    shown = np.asarray(given)
    expected = (len(frames), *subject.presses.protocol.grid.grid().shape)
    require(
        shown.ndim == 4 and (len(shown), *shown.shape[2:]) == expected,
        f"maps of shape {shown.shape} for {expected[0]} frames on a grid of {expected[1:]}",
    )
    require(np.isfinite(shown).all(), "a map holds a value that is not finite")
    read = subject.check_answers(model.read_maps(shown), len(frames))
    gap = difference(read, subject.answers)
    require(gap <= CLOSE, f"answers read from the maps differ by {gap:.3g}")


def stages(subject: ModelSubject) -> None:
    """The timed stages, one after the other, give the answers of ``predict``."""
    for frames in (subject.test_examples.frames[:1], subject.test_examples.frames[:BATCH]):
        value: object = list(frames)
        for _, stage in subject.trained().stages():
            value = stage(value)
        if not isinstance(value, list):
            raise Failed(f"the last stage gave a {type(value).__name__}, no list")
        gap = difference(subject.check_answers(value, len(frames)), subject.answers[: len(frames)])
        require(gap <= CLOSE, f"the answers of the stages differ from predict's by {gap:.3g}")


def refinement(subject: ModelSubject) -> None:
    """Refined contacts are some of the model's own, none moved farther than the stated reach."""
    if not subject.spec.refinable or subject.answer_kind != "contacts":
        raise NotApplicable("its contacts are not refined")
    shown = subject.examples[:FIT], subject.examples[FIT : FIT + VALIDATION]
    (frames, truth), validation = ((list(part.frames), list(part.truth)) for part in shown)
    try:
        refine = Refinement.learn(frames, truth, validation)
    except UserError as error:  # a run goes on without it, too
        raise NotApplicable(f"{subject.presses.name} has no fields ({error})") from None
    refined = refine(list(subject.test_examples.frames), subject.answers)
    for before, after in zip(subject.answers, refined, strict=True):
        if not isinstance(before, Contacts) or not isinstance(after, Contacts):
            raise Failed(f"a refined answer is of type {type(after).__name__}")
        require(len(after) <= len(before), "a contact was added")
        for contact in after.xy:
            nearest = np.linalg.norm(before.xy - contact, axis=1).min()
            require(nearest <= REACH_MM, f"a contact moved {nearest:.2f} mm")


def adapt(subject: ModelSubject) -> None:
    """Labelled frames give equal answers when they are shown again; none take their effect back."""
    model, shown, asked = subject.trained(), subject.examples[:SHOWN], subject.test_examples.frames
    if model.adapt([], []) is None:
        raise NotApplicable("the model cannot adapt")
    try:
        chosen = model.adapt(shown.frames, shown.truth)
        if chosen is None:
            raise NotApplicable("the model cannot adapt")
        as_json(dict(chosen), "what adapt returned")
        once = subject.predict(model, asked)
        for count in (SHOWN // 2, SHOWN):
            model.adapt(shown.frames[:count], shown.truth[:count])
        gap = difference(subject.predict(model, asked), once)
        require(gap <= EXACT, f"after other labelled frames, answers differ by {gap:.3g}")
    finally:
        model.adapt([], [])
    gap = difference(subject.predict(model, asked), subject.answers)
    require(gap <= EXACT, f"without labelled frames, answers differ by {gap:.3g} from before")


def _with_images(frame: Frame, change: Callable[[Image], Image]) -> Frame:
    """Return the frame with image and rest image changed in the same way."""
    rest = None if frame.rest is None else change(frame.rest)
    return replace(frame, signal=change(frame.image), rest=rest)
