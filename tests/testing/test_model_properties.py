"""Every property of a model is held by the good example and catches a broken one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tactibench import Contacts, Frame, PlatePose, UserError
from tactibench.testing import examine, properties, run_checks, subject_of
from tactibench.testing.runner import FAILED, PASSED, SKIPPED

PROPERTIES = {one.name: one for one in properties("model")}
SMALL = {"model": {"size": "8"}}


def refuses_to_be_small(good: Any) -> Any:
    class Broken(good):
        def __init__(self, context: Any, size: int = 8, penalty: float = 1.0) -> None:
            super().__init__(context, size, penalty)
            self.step = 1 / (size - 4)

    return Broken


def no_report(good: Any) -> Any:
    class Broken(good):
        def fit(self, *arguments: Any, **keys: Any) -> Any:
            super().fit(*arguments, **keys)

    return Broken


def does_not_train(good: Any) -> Any:
    class Broken(good):
        def fit(self, *arguments: Any, **keys: Any) -> Any:
            raise RuntimeError("diverged")

    return Broken


def notes_that_are_not_json(good: Any) -> Any:
    class Broken(good):
        def fit(self, *arguments: Any, **keys: Any) -> Any:
            return replace(super().fit(*arguments, **keys), notes={"loss": float("nan")})

    return Broken


def answering(change: Callable[[list[Any], list[Frame]], Any]) -> Callable[[Any], Any]:
    """A model whose answers are changed. change: answers and frames -> answers."""

    def broken(good: Any) -> Any:
        class Broken(good):
            def predict(self, frames: Any) -> Any:
                return change(super().predict(frames), list(frames))

        return Broken

    return broken


def moved(answers: list[Any], x: Any) -> list[Any]:
    return [
        Contacts(a.xy + np.array([dx, 0]), a.depth, a.score)
        for a, dx in zip(answers, np.broadcast_to(x, len(answers)), strict=True)
    ]


def two(answers: list[Any], _: Any) -> list[Any]:
    return [Contacts(np.repeat(a.xy, 2, 0), np.repeat(a.depth, 2), np.ones(2)) for a in answers]


def global_noise(good: Any) -> Any:
    class Broken(good):
        def fit(self, *arguments: Any, **keys: Any) -> Any:
            report = super().fit(*arguments, **keys)
            self.mean_answer = self.mean_answer + np.random.default_rng().normal(0, 0.1, 3)
            return report

    return Broken


def forgets_to_save(good: Any) -> Any:
    class Broken(good):
        def save(self, directory: Any) -> None:
            self.mean_answer, kept = np.zeros(3), self.mean_answer
            super().save(directory)
            self.mean_answer = kept

    return Broken


def saves_nothing(good: Any) -> Any:
    class Broken(good):
        def save(self, directory: Any) -> None: ...

    return Broken


def loads_anything(good: Any) -> Any:
    class Broken(good):
        def load(self, directory: Any) -> None:
            try:
                super().load(directory)
            except UserError:
                return

    return Broken


def loads_with_a_traceback(good: Any) -> Any:
    class Broken(good):
        def load(self, directory: Any) -> None:
            np.load(directory / "weights.npz")["weights"]
            super().load(directory)

    return Broken


def scribbles(good: Any) -> Any:
    class Broken(good):
        def fit(self, frames: Any, *arguments: Any, **keys: Any) -> Any:
            for frame in frames:
                if frame.image.flags.writeable:
                    frame.image[0, 0] += 1
            return super().fit(frames, *arguments, **keys)

    return Broken


def scribbles_on_test_frames(good: Any) -> Any:
    class Broken(good):
        def predict(self, frames: Any) -> Any:
            for frame in frames:
                if frame.image.flags.writeable:
                    frame.image[0, 0] += 1
            return super().predict(frames)

    return Broken


def one_size(answers: list[Any], frames: list[Frame]) -> list[Any]:
    np.stack([frame.image.reshape(48, 48) for frame in frames]) if frames else None
    return answers


def shown_to(wish: str) -> Callable[[Any], Any]:
    """A model that mishandles floats. wish: "scaled" or "nan"."""

    def broken(good: Any) -> Any:
        class Broken(good):
            def predict(self, frames: Any) -> Any:
                if wish == "scaled":
                    frames = [
                        replace(
                            f,
                            image=(f.image * (1 / 255 if f.image.dtype.kind == "f" else 1)).astype(
                                np.uint8
                            ),
                        )
                        for f in frames
                    ]
                else:
                    frames = [replace(f, image=np.nan_to_num(f.image)) for f in frames]
                return super().predict(frames)

        return Broken

    return broken


def one_contact_only(good: Any) -> Any:
    class Broken(good):
        def fit(self, frames: Any, truth: Any, **keys: Any) -> Any:
            np.stack([contacts.xy for contacts in truth])
            return super().fit(frames, truth, **keys)

    return Broken


def maps_of_another_grid(good: Any) -> Any:
    class Broken(good):
        def maps(self, frames: Any) -> Any:
            self.frames = frames
            return np.zeros((len(frames), 1, 32, 32), np.float32)

        def read_maps(self, maps: Any) -> Any:
            return self.predict(self.frames)

    return Broken


def maps_that_say_something_else(good: Any) -> Any:
    class Broken(good):
        def maps(self, frames: Any) -> Any:
            return np.zeros((len(frames), 1, 64, 64), np.float32)

        def read_maps(self, maps: Any) -> Any:
            return [Contacts.none()] * len(maps)

    return Broken


def stages_for_one_frame(good: Any) -> Any:
    class Broken(good):
        def stages(self) -> Any:
            return [("forward", lambda frames: self.predict(frames)[:1])]

    return Broken


ANY, BOTH = {"max_contacts": None}, {"answers": ("contacts", "plate")}
BROKEN = [
    ("target", lambda _: type("NoModel", (), {}), {}),
    ("parameters", refuses_to_be_small, {}),
    ("fit", no_report, {}),
    ("fit", does_not_train, {}),
    ("fit", notes_that_are_not_json, {}),
    ("shapes", answering(lambda answers, _: answers[1:]), {}),
    ("shapes", answering(lambda answers, _: [PlatePose(1, 2) for _ in answers]), {}),
    ("shapes", answering(lambda answers, _: [None for _ in answers]), {}),
    ("shapes", answering(two), {}),
    ("shapes", answering(lambda answers, _: moved(answers, 4e5)), {}),
    ("finds_contacts", answering(lambda answers, _: [Contacts.none() for _ in answers]), {}),
    ("empty", answering(lambda answers, frames: answers[:] if frames[0] else []), {}),
    ("batch", answering(lambda answers, _: moved(answers, len(answers) / 10)), {}),
    ("batch", answering(lambda answers, _: moved(answers, np.arange(len(answers)))), {}),
    ("seed", global_noise, {}),
    ("save_load", forgets_to_save, {}),
    ("save_load", saves_nothing, {}),
    ("damaged_weights", loads_anything, {}),
    ("damaged_weights", loads_with_a_traceback, {}),
    ("input_unchanged", scribbles, {}),
    ("input_unchanged", scribbles_on_test_frames, {}),
    ("truth_hidden", answering(lambda a, frames: moved(a, [f.pose.x for f in frames])), {}),
    ("truth_hidden", answering(lambda a, frames: moved(a, [f.timestamp for f in frames])), {}),
    ("frame_size", answering(one_size), {}),
    ("float_frame", shown_to("scaled"), {}),
    ("nan_frame", shown_to("nan"), {}),
    ("every_answer", lambda good: good, BOTH),
    ("several", one_contact_only, ANY),
    ("maps", maps_of_another_grid, {}),
    ("maps", maps_that_say_something_else, {}),
    ("stages", stages_for_one_frame, {}),
]


@pytest.fixture
def plates(target: Callable[[str], Any]) -> Any:
    """The good sensor, which takes a plate for a tip where it touches."""

    class Plates(target("sensor")):
        def _displacement(self, scene: Any) -> Any:
            from tactibench import Indenter
            from tactibench.geometry import plate_contact_xy

            if scene.indenter.is_plate:
                x, y = plate_contact_xy(scene)
                pose = replace(scene.pose, x=x, y=y, tilt=0.0)
                scene = replace(scene, indenter=Indenter.single(), pose=pose)
            return super()._displacement(scene)

    return Plates


def test_every_property_has_a_broken_example() -> None:
    assert {name for name, _, _ in BROKEN} == set(PROPERTIES)


def test_the_good_one_holds_them_all(host: Any) -> None:
    report = run_checks(
        PROPERTIES.values(), subject_of("model", "good_model", host=host(), parameters=SMALL)
    )
    assert [finding.line() for finding in report.findings if finding.outcome == FAILED] == []
    assert report.ok
    skipped = {one.checked.name for one in report.findings if one.outcome == SKIPPED}
    assert skipped == {"every_answer", "several", "maps"}


@pytest.mark.parametrize(("name", "broken", "fields"), BROKEN)
def test_a_broken_one_is_caught(
    host: Any, target: Any, plates: Any, name: str, broken: Any, fields: dict[str, Any]
) -> None:
    built = host("model", broken(target("model")), **fields)
    subject = subject_of("model", "good_model", host=built, parameters=SMALL)
    if name == "every_answer":
        sensor = plates(_context())
        subject = replace(subject, presses=replace(subject.presses, sensor=sensor))
    finding = examine(PROPERTIES[name], subject)
    assert finding.outcome == FAILED
    assert finding.message


def _context() -> Any:
    from tactibench import SensorContext

    return SensorContext(np.random.SeedSequence(1))


def test_a_model_that_does_not_train_is_reported_once(host: Any, target: Any) -> None:
    built = host("model", does_not_train(target("model")))
    subject = subject_of("model", "good_model", host=built, parameters=SMALL)
    report = run_checks(PROPERTIES.values(), subject)
    assert [one.checked.name for one in report.findings if one.outcome == FAILED] == ["fit"]
    assert report.count(PASSED) == 2
    assert "RuntimeError: diverged" in next(f.message for f in report.findings if f.message)


def test_a_spec_whose_class_is_not_there_is_caught(host: Any) -> None:
    built = host("model", None, target="tactibench_good_model.model:NotThere")
    finding = examine(PROPERTIES["target"], subject_of("model", "good_model", host=built))
    assert (finding.outcome, "NotThere" in finding.message) == (FAILED, True)


def test_a_sensor_that_presses_no_plate_leaves_plates_out(host: Any, target: Any) -> None:
    subject = subject_of("model", "good_model", host=host("model", target("model"), **BOTH))
    assert examine(PROPERTIES["every_answer"], subject).outcome == SKIPPED
