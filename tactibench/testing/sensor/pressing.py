"""How a sensor is opened, repeated, described, and what it refuses."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from tactibench.contacts import Frame, Indenter, Pose, Scene
from tactibench.errors import UserError
from tactibench.geometry import true_contacts
from tactibench.testing.parameters import check_parameters
from tactibench.testing.property import Failed, NotApplicable, guarded, refused, require
from tactibench.testing.sensor.subject import SensorSubject, change, tip

METHODS = ("__enter__", "__exit__", "rest", "press", "press_many", "describe")


def target(subject: SensorSubject) -> None:
    """The class behind the spec loads, builds, and has the methods of a sensor."""
    with guarded(f"building {subject.spec.target}"):
        sensor = subject.described
    lacking = [name for name in METHODS if not callable(getattr(sensor, name, None))]
    require(not lacking, f"it has no {', '.join(lacking)}")


def parameters(subject: SensorSubject) -> None:
    """Every allowed value of a parameter builds or is refused in words; any other is refused."""
    check_parameters(subject.spec, subject.values, subject.build)


class _Mishap(Exception):  # noqa: N818
    """Raised inside a ``with`` block, to see it come out."""


def context_manager(subject: SensorSubject) -> None:
    """`with` gives something to press, passes on what is raised inside, and can be entered anew."""
    sensor = subject.build()
    with sensor as opened:
        require(opened is not None, "__enter__ returned None")
        first = opened.press(subject.scenes[0])
    caught = False
    try:
        with sensor:
            raise _Mishap
    except _Mishap:
        caught = True
    require(caught, "__exit__ swallowed an exception raised inside")
    with guarded("pressing after the sensor was closed and opened again"), sensor as opened:
        again = opened.press(subject.scenes[0])
    require(again.image.shape == first.image.shape, "its frames have another shape")


def determinism(subject: SensorSubject) -> None:
    """Two sensors with the same seed see the same frames."""
    subject.must_repeat()
    first, second = (subject.pressed(*subject.scenes, seed=7) for _ in range(2))
    _equal(first, second, "two sensors with the same seed")


def press_many(subject: SensorSubject) -> None:
    """press_many gives the frames that press would give, in order, of any iterable."""
    subject.must_repeat()
    expected = subject.pressed(*subject.scenes)
    with subject.build() as sensor:
        require(list(sensor.press_many([])) == [], "no scenes gave frames")
    with subject.build() as sensor:
        found = list(sensor.press_many(iter(subject.scenes)))
    _equal(expected, found, "press and press_many")


def refusals(subject: SensorSubject) -> None:
    """A scene far too deep or not finite is refused, one far beside the sensor touches nothing."""
    wrong = {
        "a tip pressed 10 cm deep": tip(0.0, 0.0, 100.0),
        "a scene at x = NaN": tip(float("nan"), 0.0, 2.0),
        "a scene at infinite depth": tip(0.0, 0.0, float("inf")),
    }
    if subject.own_scenes:
        there = set(_scenes(subject).values())
        known = subject.scenes[0]
        other = replace(known, pose=replace(known.pose, depth=known.pose.depth + 0.0123))
        require(other not in there, "the check found no scene that is not there")
        wrong["a scene that it does not have"] = other
    with subject.build() as sensor:
        for what, scene in wrong.items():
            with refused(what):
                sensor.press(scene)
            with refused(f"{what}, by press_many,"):
                list(sensor.press_many([scene]))
        with guarded("a press after a refused one"):
            press = sensor.press(subject.scenes[0])
        try:
            beside = sensor.press(tip(100.0, 0.0, 2.0))
        except UserError:
            return
        rest = sensor.rest()
    beyond, touched = change(beside, rest).mean(), change(press, rest).mean()
    found = f"a tip 10 cm beside it changes the frame by {beyond:.3g}, a press by {touched:.3g}"
    require(beyond < 0.5 * touched, found)


def describe(subject: SensorSubject) -> None:
    """describe gives JSON values, the same for equal parameters, before and after a press."""
    sensor = subject.build()
    before = _text(sensor.describe())
    with sensor as opened:
        opened.press(subject.scenes[0])
    require(_text(sensor.describe()) == before, "a press changed the description")
    require(_text(subject.build(seed=1).describe()) == before, "it depends on the seed")


def scenes(subject: SensorSubject) -> None:
    """A sensor that has scenes has some, no two alike, and presses each that it names."""
    found = _scenes(subject)
    require(found, "it has no scene")
    require(len(set(found.values())) == len(found), "two names stand for one scene")
    with guarded("pressing scenes that it has"):
        subject.pressed(*subject.scenes)


def surface(subject: SensorSubject) -> None:
    """A known surface is (H, W) of the grid, finite, and deepest within 2 mm of the contact."""
    sensor = subject.described
    subject.must_press_anything()
    grid = subject.keys.grid.grid()
    surface = sensor.surface(tip(3.0, -2.0, 2.0), grid)
    if surface is None:
        raise NotApplicable("it knows no surface")
    found = np.asarray(surface)
    require(found.shape == grid.shape, f"shape {found.shape}, expected {grid.shape}")
    require(np.isfinite(found).all(), "it is not finite")
    row, column = np.unravel_index(int(found.argmax()), found.shape)
    x, y = grid.xy(int(row), int(column)).tolist()
    # On a dome the skin gives way inward along its normal, where the tip first touches.
    near = np.hypot(x - 3.0, y + 2.0)
    require(near <= 2.0, f"pressed at x 3, y -2 mm, it is deepest at x {x:.1f}, y {y:.1f} mm")


def bound(subject: SensorSubject) -> None:
    """A known bound is (K, 3) and positive for the K true contacts of a scene."""
    sensor = subject.described
    subject.must_press_anything()
    radius = subject.keys.workspace.dome_radius_mm
    for scene in (tip(1.0, 2.0, 2.0), Scene(Indenter.dual(8.0), Pose(depth=3.0))):
        known = sensor.bound(scene)
        if known is None:
            raise NotApplicable("it knows no bound")
        found = np.asarray(known)
        wanted = (len(true_contacts(scene, radius)), 3)
        require(found.shape == wanted, f"shape {found.shape}, expected {wanted}")
        require((found > 0).all(), f"{found.tolist()} mm; a bound is positive")


def _scenes(subject: SensorSubject) -> Mapping[str, Scene]:
    own = subject.described.scenes()
    if own is None:
        raise NotApplicable("it presses any scene")
    return own


def _equal(first: list[Frame], second: list[Frame], what: str) -> None:
    require(len(first) == len(second), f"{what}: {len(first)} and {len(second)} frames")
    for number, (one, other) in enumerate(zip(first, second, strict=True), 1):
        require(np.array_equal(one.image, other.image), f"{what} differ in the image {number}")
        require(one.pose == other.pose, f"{what} differ in pose {number}")


def _text(value: dict[str, Any]) -> str:
    require(isinstance(value, dict), f"describe gave a {type(value).__name__}")
    try:
        return json.dumps(value, sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise Failed(f"describe cannot be written as JSON: {error}") from error
