"""Every property of a sensor is held by the good example and catches a broken one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tactibench import Frame, Indenter, Pose, Scene, UserError
from tactibench.testing import examine, properties, run_checks, subject_of
from tactibench.testing.runner import FAILED, PASSED, SKIPPED

PROPERTIES = {one.name: one for one in properties("sensor")}
KEPT = {
    f"press {number}": Scene(Indenter.single(), Pose(x, 0.5, 0, 0, depth))
    for number, (x, depth) in enumerate([(0.0, 1.0), (0.0, 2.0), (3.0, 4.0)])
}


def with_methods(**methods: Any) -> Callable[[Any], Any]:
    """The good class with some attributes of its own."""
    return lambda good: type("Broken", (good,), methods)


def pressing(change: Callable[[Frame, Scene], Frame]) -> Callable[[Any], Any]:
    """A sensor whose presses are changed."""

    def broken(good: Any) -> Any:
        class Broken(good):
            def press(self, scene: Any) -> Any:
                return change(super().press(scene), scene)

        return Broken

    return broken


def scene_changed(change: Callable[[Pose], Pose]) -> Callable[[Any], Any]:
    """A sensor that presses something else than it says."""

    def broken(good: Any) -> Any:
        class Broken(good):
            def press(self, scene: Any) -> Any:
                other = replace(scene, pose=change(scene.pose))
                return replace(super().press(other), pose=scene.pose)

        return Broken

    return broken


def half_the_size_is_a_crash(good: Any) -> Any:
    class Broken(good):
        def __init__(self, context: Any, size: int = 96, **keys: Any) -> None:
            super().__init__(context, size, **keys)
            self.step = 1 / (size - 32)

    return Broken


def unseeded(good: Any) -> Any:
    class Broken(good):
        def press(self, scene: Any) -> Any:
            frame = super().press(scene)
            noise = np.random.default_rng().integers(0, 3, frame.image.shape)
            return replace(frame, image=np.clip(frame.image + noise, 0, 255).astype(np.uint8))

    return Broken


def rest_drifts(good: Any) -> Any:
    class Broken(good):
        def rest(self) -> Any:
            frame = super().rest()
            return frame if not self._count else replace(frame, image=255 - frame.image)

    return Broken


def sees_anything(good: Any) -> Any:
    class Broken(good):
        def _displacement(self, scene: Any) -> Any:
            try:
                return super()._displacement(scene)
            except UserError:
                return np.zeros_like(self._pins)

    return Broken


def raises_a_value_error(good: Any) -> Any:
    class Broken(good):
        def _displacement(self, scene: Any) -> Any:
            try:
                return super()._displacement(scene)
            except UserError as error:
                raise ValueError(error) from error

    return Broken


def counts_in_its_description(good: Any) -> Any:
    return with_methods(describe=lambda self: {"count": self._count})(good)


def flat(_self: Any, scene: Any, grid: Any) -> Any:
    return np.zeros((3, 3))


def elsewhere(_self: Any, scene: Any, grid: Any) -> Any:
    found = np.zeros(grid.shape)
    found[0, 0] = 1
    return found


def grey(frame: Frame, _: Scene) -> Frame:
    return replace(frame, image=np.full_like(frame.image, 90))


def as_floats(frame: Frame, _: Scene) -> Frame:
    return replace(frame, image=frame.image / 255)


def mirrored(frame: Frame, _: Scene) -> Frame:
    return replace(frame, image=frame.image[:, ::-1])


def turned(frame: Frame, _: Scene) -> Frame:
    return replace(frame, image=frame.image.T)


BROKEN = [
    ("target", lambda _: type("NoSensor", (), {})),
    ("parameters", half_the_size_is_a_crash),
    ("context_manager", with_methods(__exit__=lambda *_: True)),
    ("context_manager", with_methods(__enter__=lambda self: None)),
    ("frames", pressing(as_floats)),
    ("frames", pressing(grey)),
    ("frames", pressing(lambda frame, _: replace(frame, pose=Pose()))),
    ("frames", pressing(lambda frame, _: replace(frame, rest=frame.image[:5]))),
    ("rest_frame", with_methods(rest=lambda self: Frame(self._rest[:9], 0.0, Pose()))),
    ("rest_frame", rest_drifts),
    ("deeper", scene_changed(lambda pose: replace(pose, depth=2.0))),
    ("deeper", scene_changed(lambda pose: replace(pose, depth=max(0.1, 6.5 - pose.depth)))),
    ("direction", pressing(mirrored)),
    ("direction", pressing(turned)),
    ("direction", scene_changed(lambda pose: replace(pose, x=0.0, y=0.0))),
    ("timestamps", pressing(lambda frame, _: replace(frame, timestamp=0.0))),
    ("timestamps", pressing(lambda frame, _: replace(frame, timestamp=float("nan")))),
    ("determinism", unseeded),
    (
        "press_many",
        with_methods(press_many=lambda self, scenes: reversed([self.press(one) for one in scenes])),
    ),
    (
        "press_many",
        with_methods(
            press_many=lambda self, scenes: iter([self.press(one) for one in list(scenes)[1:]])
        ),
    ),
    ("refusals", sees_anything),
    ("refusals", raises_a_value_error),
    ("refusals", with_methods(press_many=lambda self, scenes: iter([self.rest()]))),
    ("describe", with_methods(describe=lambda self: {"pins": self._pins})),
    ("describe", with_methods(describe=lambda self: {"noise": float("nan")})),
    ("describe", counts_in_its_description),
    ("describe", with_methods(describe=lambda self: {"seed": str(self._seed)})),
    ("scenes", with_methods(scenes=lambda self: {**KEPT, "again": KEPT["press 0"]})),
    ("scenes", with_methods(scenes=lambda self: {})),
    ("surface", with_methods(surface=flat)),
    ("surface", with_methods(surface=elsewhere)),
    ("bound", with_methods(bound=lambda self, scene: np.ones((1, 3)))),
    ("bound", with_methods(bound=lambda self, scene: -np.ones((len(scene.indenter.offsets), 3)))),
]


def test_every_property_has_a_broken_example() -> None:
    assert {name for name, _ in BROKEN} == set(PROPERTIES)


def test_the_good_one_holds_them_all(host: Any) -> None:
    report = run_checks(PROPERTIES.values(), subject_of("sensor", "good_sensor", host=host()))
    assert [finding.line() for finding in report.findings if finding.outcome == FAILED] == []
    skipped = {one.checked.name for one in report.findings if one.outcome == SKIPPED}
    assert skipped == {"scenes", "surface", "bound"}


@pytest.mark.parametrize(("name", "broken"), BROKEN)
def test_a_broken_one_is_caught(host: Any, target: Any, name: str, broken: Any) -> None:
    built = host("sensor", broken(target("sensor")))
    finding = examine(PROPERTIES[name], subject_of("sensor", "good_sensor", host=built))
    assert finding.outcome == FAILED
    assert finding.message


def test_a_sensor_that_has_scenes_is_asked_for_those(host: Any, target: Any) -> None:
    def press(self: Any, scene: Any) -> Any:
        if scene not in KEPT.values():
            raise UserError("it was not recorded.")
        return target("sensor").press(self, scene)

    broken = with_methods(scenes=lambda self: dict(KEPT), press=press)
    built = host("sensor", broken(target("sensor")), origin="real")
    report = run_checks(PROPERTIES.values(), subject_of("sensor", "good_sensor", host=built))
    outcomes = {one.checked.name: one.outcome for one in report.findings}
    assert [name for name, outcome in outcomes.items() if outcome == FAILED] == []
    assert outcomes["scenes"] == outcomes["determinism"] == outcomes["refusals"] == PASSED
    assert outcomes["deeper"] == outcomes["direction"] == SKIPPED


def test_a_real_sensor_need_not_repeat_itself(host: Any, target: Any) -> None:
    subject = subject_of("sensor", "good_sensor", host=host("sensor", None, origin="real"))
    assert examine(PROPERTIES["determinism"], subject).outcome == SKIPPED
    assert examine(PROPERTIES["press_many"], subject).outcome == SKIPPED
