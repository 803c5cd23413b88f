"""Every property of a model is held by the good example and catches a broken one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from broken import Break, changing, with_attributes

from tactibench import Contacts, Frame, PlatePose, UserError
from tactibench.plugins import PluginHost
from tactibench.testing import FAILED, PASSED, SKIPPED, examine, properties, run_checks, subject_of

PROPERTIES = {one.name: one for one in properties("model")}
SMALL = {"model": {"size": "8"}}


def refuses_to_be_small(self: Any, init: Any, context: Any, size: int = 8, **keys: Any) -> None:
    init(context, size, **keys)
    self.step = 1 / (size - 4)


def does_not_train(*_: Any, **__: Any) -> Any:
    raise RuntimeError("diverged")


def notes_that_are_not_json(_: Any, fit: Any, *arguments: Any, **keys: Any) -> Any:
    return replace(fit(*arguments, **keys), notes={"loss": float("nan")})


def answering(change: Callable[[list[Any], list[Frame]], Any]) -> Break:
    """A model whose answers are changed. change: answers and frames -> answers."""
    return changing("predict", lambda _, predict, frames: change(predict(frames), list(frames)))


def shown(change: Callable[[Any], Any]) -> Break:
    """A model that sees other images. change: image -> image."""

    def predict_changed(_: Any, predict: Any, frames: Any) -> Any:
        return predict([replace(frame, signal=change(frame.image)) for frame in frames])

    return changing("predict", predict_changed)


def moved(answers: list[Any], x: Any) -> list[Any]:
    return [
        Contacts(a.xy + np.array([dx, 0]), a.depth, a.score)
        for a, dx in zip(answers, np.broadcast_to(x, len(answers)), strict=True)
    ]


def two(answers: list[Any], _: Any) -> list[Any]:
    return [Contacts(np.repeat(a.xy, 2, 0), np.repeat(a.depth, 2), np.ones(2)) for a in answers]


def by_the_first_rest(answers: list[Any], frames: list[Frame]) -> list[Any]:
    return moved(answers, [np.array_equal(f.rest, frames[0].rest) for f in frames])


def in_metres(answer: Contacts) -> Contacts:
    return Contacts(answer.xy / 1000, answer.depth / 1000, answer.score)


def global_noise(self: Any, fit: Any, *arguments: Any, **keys: Any) -> Any:
    report = fit(*arguments, **keys)
    self.mean_answer = self.mean_answer + np.random.default_rng().normal(0, 0.1, 3)
    return report


def noise_of_the_seed(self: Any, fit: Any, *arguments: Any, **keys: Any) -> Any:
    report = fit(*arguments, **keys)
    self.mean_answer = self.mean_answer + keys["rng"].normal(0, 0.1, 3)
    return report


def forgets_to_save(self: Any, save: Any, directory: Any) -> None:
    self.mean_answer, kept = np.zeros(3), self.mean_answer
    save(directory)
    self.mean_answer = kept


def scribbles(_: Any, method: Any, frames: Any, *arguments: Any, **keys: Any) -> Any:
    for frame in frames:
        if frame.image.flags.writeable:
            frame.image[0, 0] += 1
    return method(frames, *arguments, **keys)


def maps_of_another_grid(good: Any) -> Any:
    class Broken(good):
        def maps(self, frames: Any) -> Any:
            self.frames = frames
            return np.zeros((len(frames), 1, 32, 32), np.float32)

        def read_maps(self, maps: Any) -> Any:
            return self.predict(self.frames)

    return Broken


maps_that_say_something_else = with_attributes(
    maps=lambda _, frames: np.zeros((len(frames), 1, 64, 64), np.float32),
    read_maps=lambda _, maps: [Contacts.none()] * len(maps),
)
stages_for_one_frame = with_attributes(
    stages=lambda self: [("forward", lambda frames: self.predict(frames)[:1])]
)


def adapting(step: Callable[[Any, int], Any], chosen: Any = None) -> Break:
    """A model that labelled frames move. step: its mean answer as trained and now, how many."""

    def adapt(self: Any, frames: Any, _: Any) -> Any:
        if not hasattr(self, "as_trained"):
            self.as_trained = self.mean_answer
        self.mean_answer = step(self, len(frames))
        return {"frames": len(frames)} if chosen is None or not frames else chosen

    return with_attributes(adapt=adapt)


BROKEN = [
    ("target", lambda _: type("NoModel", (), {}), {}),
    ("parameters", changing("__init__", refuses_to_be_small), {}),
    ("fit", with_attributes(fit=lambda *_, **__: None), {}),
    ("fit", changing("fit", does_not_train), {}),
    ("fit", changing("fit", notes_that_are_not_json), {}),
    ("shapes", answering(lambda answers, _: answers[1:]), {}),
    ("shapes", answering(lambda answers, _: [PlatePose(1, 2) for _ in answers]), {}),
    ("shapes", answering(two), {}),
    ("shapes", answering(lambda answers, _: moved(answers, 4e5)), {}),
    ("shapes", answering(lambda answers, _: [in_metres(answer) for answer in answers]), {}),
    ("finds_contacts", answering(lambda answers, _: [Contacts.none() for _ in answers]), {}),
    ("empty", answering(lambda answers, frames: answers[:] if frames[0] else []), {}),
    ("batch", answering(lambda answers, _: moved(answers, len(answers) / 10)), {}),
    ("batch", answering(lambda answers, _: moved(answers, np.arange(len(answers)))), {}),
    ("sensors", answering(by_the_first_rest), {}),
    ("seed", changing("fit", global_noise), {}),
    ("deterministic", changing("fit", noise_of_the_seed), {"deterministic": True}),
    ("save_load", changing("save", forgets_to_save), {}),
    ("save_load", with_attributes(save=lambda *_: None), {}),
    ("input_unchanged", changing("fit", scribbles), {}),
    ("input_unchanged", changing("predict", scribbles), {}),
    ("nan_frame", shown(np.nan_to_num), {}),
    ("maps", maps_of_another_grid, {}),
    ("maps", maps_that_say_something_else, {}),
    ("stages", stages_for_one_frame, {}),
    ("adapt", adapting(lambda self, count: self.mean_answer + 0.1 * count), {}),
    ("adapt", adapting(lambda self, _: self.as_trained, {"shift": np.zeros(3)}), {}),
]


def by_session(answers: list[Any], frames: list[Frame]) -> list[Any]:
    """Places that are turned round in a session of another name."""
    return [
        a if frame.session.startswith("day") else replace(a, probability=a.probability[::-1])
        for a, frame in zip(answers, frames, strict=True)
    ]


def each(change: Callable[[Any, int], dict[str, Any]]) -> Break:
    """A model of places. change: an answer and the number of frames -> fields that differ."""
    return answering(lambda answers, _: [replace(a, **change(a, len(answers))) for a in answers])


BROKEN_SITES = [
    ("sessions", answering(by_session)),
    ("shapes", each(lambda a, _: {"names": a.names[::-1]})),
    ("shapes", each(lambda *_: {"probability": (2.0,) * 4})),
    ("batch", each(lambda _, count: {"touched": (count > 1,) * 4})),
    ("finds_contacts", each(lambda *_: {"touched": (False,) * 4})),
]


@pytest.mark.parametrize(("name", "broken"), BROKEN_SITES)
def test_a_broken_model_of_named_places_is_caught(host: Any, name: str, broken: Any) -> None:
    spec = PluginHost().models.for_answer("sites")["kernel"]
    fields = {"answers": spec.answers, "reads": spec.reads, "parameters": spec.parameters}
    built = host("model", broken(spec.load()), **fields)
    subject = subject_of("model", "good_model", host=built, answer="sites")
    assert examine(PROPERTIES[name], subject).outcome == FAILED


def test_a_kind_of_answer_that_a_model_has_not_is_one_sentence() -> None:
    with pytest.raises(UserError, match="answers contacts and plate, but not 'sites'"):
        subject_of("model", "unet", answer="sites")


def test_every_property_has_a_broken_example() -> None:
    core = {"refinement"}  # no model can break it, see the next test
    broken = {name for name, *_ in [*BROKEN, *BROKEN_SITES]}
    assert broken == set(PROPERTIES) - core


def test_a_refinement_beyond_its_reach_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    subject = subject_of("model", "kernel", host=PluginHost())  # it learns in a second
    assert examine(PROPERTIES["refinement"], subject).outcome == PASSED
    monkeypatch.setattr("tactibench.testing.model.REACH_MM", -1.0)
    assert examine(PROPERTIES["refinement"], subject).outcome == FAILED


def test_the_good_one_holds_them_all(host: Any) -> None:
    report = run_checks(
        PROPERTIES.values(), subject_of("model", "good_model", host=host(), parameters=SMALL)
    )
    assert [finding.line() for finding in report.findings if finding.outcome == FAILED] == []
    assert report.ok
    skipped = {one.checked.name for one in report.findings if one.outcome == SKIPPED}
    assert skipped == {"sessions", "deterministic", "maps", "refinement", "adapt"}


def test_a_model_that_adapts_and_forgets_is_good(host: Any, target: Any) -> None:
    forgets = adapting(lambda self, count: self.as_trained + 0.1 * count)
    built = host("model", forgets(target("model")))
    subject = subject_of("model", "good_model", host=built, parameters=SMALL)
    assert examine(PROPERTIES["adapt"], subject).outcome == PASSED


@pytest.mark.parametrize(("name", "broken", "fields"), BROKEN)
def test_a_broken_one_is_caught(
    host: Any, target: Any, name: str, broken: Any, fields: dict[str, Any]
) -> None:
    built = host("model", broken(target("model")), **fields)
    subject = subject_of("model", "good_model", host=built, parameters=SMALL)
    finding = examine(PROPERTIES[name], subject)
    assert finding.outcome == FAILED
    assert finding.message


@pytest.mark.parametrize(("first", "outcome"), [([1, 0], PASSED), ([0], FAILED)])
def test_answers_are_sets_of_contacts(
    host: Any, target: Any, first: list[int], outcome: str
) -> None:
    """Those of a frame alone come in another order, or lack one."""

    def change(answers: list[Any], _: Any) -> list[Any]:
        both = np.array([[0.0, 0.0], [5.0, 1.0]])
        pairs = [Contacts(a.xy + both, np.array([2.0, 3.0]), np.ones(2)) for a in answers]
        rows = first if len(answers) == 1 else [0, 1]
        return [Contacts(a.xy[rows], a.depth[rows], a.score[rows]) for a in pairs]

    built = host("model", answering(change)(target("model")), max_contacts=2)
    subject = subject_of("model", "good_model", host=built, parameters=SMALL)
    assert examine(PROPERTIES["batch"], subject).outcome == outcome


def test_a_model_that_does_not_train_is_reported_once(host: Any, target: Any) -> None:
    built = host("model", changing("fit", does_not_train)(target("model")))
    subject = subject_of("model", "good_model", host=built, parameters=SMALL)
    report = run_checks(PROPERTIES.values(), subject)
    assert [one.checked.name for one in report.findings if one.outcome == FAILED] == ["fit"]
    assert report.count(PASSED) == 2
    assert "RuntimeError: diverged" in next(f.message for f in report.findings if f.message)


def test_a_spec_whose_class_is_not_there_is_caught(host: Any) -> None:
    built = host("model", None, target="tactibench_good_model.model:NotThere")
    finding = examine(PROPERTIES["target"], subject_of("model", "good_model", host=built))
    assert (finding.outcome, "NotThere" in finding.message) == (FAILED, True)
