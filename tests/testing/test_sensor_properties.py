"""Every property of a sensor is held by the good example and catches a broken one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from broken import Break, changing, with_attributes

from tactibench import Frame, Indenter, Pose, Scene, UserError
from tactibench.testing import FAILED, PASSED, SKIPPED, examine, properties, run_checks, subject_of

PROPERTIES = {one.name: one for one in properties("sensor")}
KEPT = {
    f"press {number}": Scene(Indenter.single(), Pose(x, 0.5, 0, 0, depth))
    for number, (x, depth) in enumerate([(0.0, 1.0), (0.0, 2.0), (3.0, 4.0)])
}


def pressing(change: Callable[[Frame, Scene], Frame]) -> Break:
    """A sensor whose presses are changed."""
    return changing("press", lambda _, press, scene: change(press(scene), scene))


def scene_changed(change: Callable[[Pose], Pose]) -> Break:
    """A sensor that presses something else than it says."""

    def press_changed(_: Any, press: Any, scene: Any) -> Any:
        return replace(press(replace(scene, pose=change(scene.pose))), pose=scene.pose)

    return changing("press", press_changed)


def half_the_size_is_a_crash(self: Any, init: Any, context: Any, size: int = 96, **k: Any) -> None:
    init(context, size, **k)
    self.step = 1 / (size - 32)


def noisy(frame: Frame, _: Scene) -> Frame:
    noise = np.random.default_rng().integers(0, 3, frame.image.shape)
    return replace(frame, signal=np.clip(frame.image + noise, 0, 255).astype(np.uint8))


def rest_drifts(self: Any, rest: Any) -> Any:
    frame = rest()
    return frame if not self._count else replace(frame, signal=255 - frame.image)


def sees_anything(self: Any, displacement: Any, scene: Any) -> Any:
    try:
        return displacement(scene)
    except UserError:
        return np.zeros_like(self._pins)


def raises_a_value_error(_: Any, displacement: Any, scene: Any) -> Any:
    try:
        return displacement(scene)
    except UserError as error:
        raise ValueError(error) from error


def flat(_self: Any, scene: Any, grid: Any) -> Any:
    return np.zeros((3, 3))


def elsewhere(_self: Any, scene: Any, grid: Any) -> Any:
    found = np.zeros(grid.shape)
    found[0, 0] = 1
    return found


def grey(frame: Frame, _: Scene) -> Frame:
    return replace(frame, signal=np.full_like(frame.image, 90))


def as_floats(frame: Frame, _: Scene) -> Frame:
    return replace(frame, signal=frame.image / 255)


def mirrored(frame: Frame, _: Scene) -> Frame:
    return replace(frame, signal=frame.image[:, ::-1])


def turned(frame: Frame, _: Scene) -> Frame:
    return replace(frame, signal=frame.image.T)


BROKEN = [
    ("target", lambda _: type("NoSensor", (), {})),
    ("parameters", changing("__init__", half_the_size_is_a_crash)),
    ("context_manager", with_attributes(__exit__=lambda *_: True)),
    ("context_manager", with_attributes(__enter__=lambda self: None)),
    ("frames", pressing(as_floats)),
    ("frames", pressing(grey)),
    ("frames", pressing(lambda frame, _: replace(frame, pose=Pose()))),
    ("frames", pressing(lambda frame, _: replace(frame, rest=frame.image[:5]))),
    ("rest_frame", with_attributes(rest=lambda self: Frame(self._rest[:9], 0.0, Pose()))),
    ("rest_frame", changing("rest", rest_drifts)),
    ("deeper", scene_changed(lambda pose: replace(pose, depth=2.0))),
    ("deeper", scene_changed(lambda pose: replace(pose, depth=max(0.1, 6.5 - pose.depth)))),
    ("direction", pressing(mirrored)),
    ("direction", pressing(turned)),
    ("direction", scene_changed(lambda pose: replace(pose, x=0.0, y=0.0))),
    ("determinism", pressing(noisy)),
    ("press_many", changing("press_many", lambda _, press, scenes: iter(list(press(scenes))[1:]))),
    ("refusals", changing("_displacement", sees_anything)),
    ("refusals", changing("_displacement", raises_a_value_error)),
    ("refusals", with_attributes(press_many=lambda self, scenes: iter([self.rest()]))),
    ("describe", with_attributes(describe=lambda self: {"pins": self._pins})),
    ("describe", with_attributes(describe=lambda self: {"noise": float("nan")})),
    ("describe", with_attributes(describe=lambda self: {"count": self._count})),
    ("describe", with_attributes(describe=lambda self: {"seed": str(self._seed)})),
    ("surface", with_attributes(surface=flat)),
    ("surface", with_attributes(surface=elsewhere)),
]


def test_every_property_has_a_broken_example() -> None:
    assert {name for name, _ in BROKEN} == set(PROPERTIES)


def test_the_good_one_holds_them_all(host: Any) -> None:
    report = run_checks(PROPERTIES.values(), subject_of("sensor", "good_sensor", host=host()))
    assert [finding.line() for finding in report.findings if finding.outcome == FAILED] == []
    skipped = {one.checked.name for one in report.findings if one.outcome == SKIPPED}
    assert skipped == {"surface"}


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

    broken = with_attributes(scenes=lambda self: dict(KEPT), press=press)
    built = host("sensor", broken(target("sensor")), origin="real")
    report = run_checks(PROPERTIES.values(), subject_of("sensor", "good_sensor", host=built))
    outcomes = {one.checked.name: one.outcome for one in report.findings}
    assert [name for name, outcome in outcomes.items() if outcome == FAILED] == []
    assert outcomes["determinism"] == outcomes["refusals"] == PASSED
    assert outcomes["deeper"] == outcomes["direction"] == SKIPPED


def test_the_axes_of_a_taxel_are_no_colours(host: Any, target: Any) -> None:
    """Three axes whose mean is the same under every press."""

    def three_axes(frame: Frame) -> Frame:
        levels = frame.image.astype(np.float32)
        axes = np.stack([levels, -levels, np.zeros_like(levels)], axis=-1)
        return replace(frame, signal=axes, rest=None)

    skin = type(
        "Skin",
        (target("sensor"),),
        {
            "signal": "channels",
            "press": lambda self, scene: three_axes(target("sensor").press(self, scene)),
            "rest": lambda self: three_axes(target("sensor").rest(self)),
        },
    )
    report = run_checks(
        [PROPERTIES[name] for name in ("frames", "rest_frame", "deeper", "refusals")],
        subject_of("sensor", "good_sensor", host=host("sensor", skin)),
    )
    assert [finding.line() for finding in report.findings if finding.outcome != PASSED] == []
