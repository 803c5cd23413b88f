"""What a trained model answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactibench.contacts import Contacts, Frame, Pose
from tactibench.errors import UserError
from tactibench.run.predict import blinded
from tactibench.testing.model.subject import FIT, ModelSubject, checked, difference
from tactibench.testing.property import NotApplicable, guarded, require

TOLERANCE = 1e-3
"""mm, deg and score by which answers may differ where only the order of additions differs."""
BATCH = 8


def shapes(subject: ModelSubject) -> None:
    """One answer for every frame, of the declared kind, finite, of no more than max_contacts."""
    for answer in subject.answers:
        if isinstance(answer, Contacts) and len(answer):
            require(np.abs(answer.xy).max() < 1e3, f"a contact at {answer.xy[0]} mm; xy is in mm")


def answered(subject: ModelSubject) -> None:
    """After training, some frames are answered with a contact, so that answers can be compared."""
    if subject.asked != "contacts":
        raise NotApplicable("plate poses are asked for")
    count = sum(isinstance(one, Contacts) and len(one) > 0 for one in subject.answers)
    require(
        count,
        f"no contact in {len(subject.answers)} answers after training with "
        f"{dict(subject.values) or 'no parameters'}; where that is too short, give another "
        "parameter, such as --param model.epochs=40",
    )


def empty(subject: ModelSubject) -> None:
    """No frames give no answers, and a frame in which nothing is touched gives an allowed one."""
    model = subject.trained()
    with guarded("predict([])"):
        subject.ask(model, [])
    rest = subject.presser.rest()
    with guarded("the frame of the undeformed sensor"):
        subject.ask(model, [replace(rest, rest=rest.image)])


def batch(subject: ModelSubject) -> None:
    """A frame is answered alike alone and among seven others, to within 0.001 mm."""
    model, frames = subject.trained(), subject.seen.frames
    together = subject.ask(model, frames[:BATCH])
    alone = [subject.ask(model, [frame])[0] for frame in frames[:BATCH]]
    away = difference(alone, together)
    require(away <= TOLERANCE, f"answers differ by {away:.3g}")
    turned = subject.ask(model, frames[:BATCH][::-1])[::-1]
    away = difference(turned, together)
    require(away <= TOLERANCE, f"in another order, answers differ by {away:.3g}")


def truth_hidden(subject: ModelSubject) -> None:
    """A frame's pose and time, from which the truth could be read, change no answer."""
    frames = [blinded(frame) for frame in subject.seen.frames]
    away = difference(subject.ask(subject.trained(), frames), subject.answers)
    require(away <= TOLERANCE, f"without pose and time, answers differ by {away:.3g}")
    other = [
        Frame(frame.image, 1e6 - k, Pose(-6.0 + k, 5.0 - k, 30.0, 3.0, 0.5 + k / 3), frame.rest)
        for k, frame in enumerate(frames)
    ]
    away = difference(subject.ask(subject.trained(), other), subject.answers)
    require(
        away <= TOLERANCE, f"with the pose and time of other presses, they differ by {away:.3g}"
    )


def maps(subject: ModelSubject) -> None:
    """The shown maps are (N, C, H, W) of the grid and finite, and read_maps gives the answers."""
    model = subject.trained()
    if subject.asked != "contacts":
        raise NotApplicable("a run asks for maps of contacts only")
    frames = subject.seen.frames
    given = model.maps(list(frames))
    if given is None:
        raise NotApplicable("the model shows no maps")
    shown = np.asarray(given)
    wanted = (len(frames), *subject.presser.keys.grid.grid().shape)
    require(
        shown.ndim == 4 and (len(shown), *shown.shape[2:]) == wanted,
        f"maps of shape {shown.shape} for {wanted[0]} frames on a grid of {wanted[1:]}",
    )
    require(np.isfinite(shown).all(), "a map holds a value that is not finite")
    read = checked(model.read_maps(shown), len(frames), subject.asked, subject.spec.max_contacts)
    away = difference(read, subject.answers)
    require(away <= TOLERANCE, f"answers read from the maps differ by {away:.3g}")


def stages(subject: ModelSubject) -> None:
    """The timed stages, one after the other, give one allowed answer for every frame."""
    model = subject.trained()
    for frames in (subject.seen.frames[:1], subject.seen.frames[:BATCH]):
        value: object = list(frames)
        for name, stage in model.stages():
            with guarded(f"stage {name!r} of {len(frames)} frames"):
                value = stage(value)
        require(isinstance(value, list), f"the last stage gave a {type(value).__name__}, no list")
        assert isinstance(value, list)  # noqa: S101 - for the type checker
        checked(value, len(frames), subject.asked, subject.spec.max_contacts)


def every_answer(subject: ModelSubject) -> None:
    """A model that declares contacts and plate poses can be trained for both."""
    if len(subject.spec.answers) == 1:
        raise NotApplicable(f"the model answers {subject.spec.answers[0]} only")
    other = subject.briefly(next(a for a in subject.spec.answers if a != subject.asked))
    other.report()
    _ = other.answers


def several(subject: ModelSubject) -> None:
    """A model of several contacts can be trained on presses of one, two and three tips."""
    if subject.spec.max_contacts == 1 or subject.asked != "contacts":
        raise NotApplicable("the model answers at most one contact")
    if subject.encoder is not None and subject.encoder[0].max_contacts == 1:
        raise NotApplicable("its encoder shows at most one contact")
    try:
        presses = subject.presser.several(20)
    except UserError as error:
        raise NotApplicable(f"{subject.presser.name} presses one tip only ({error})") from None
    model = subject.briefly().build()
    with guarded("training on presses of one, two and three tips"):
        subject.fit(model, subject.examples[:FIT] + presses)
    subject.ask(model, presses.frames[:BATCH])
