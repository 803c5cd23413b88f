"""The properties of a sensor: every public function is a property and gives it its name."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from tactibench.channels import holds_channels
from tactibench.contacts import Frame, Indenter, Pose, Scene
from tactibench.errors import UserError
from tactibench.plugins import CHANNELS, IMAGE
from tactibench.testing.subjects import (
    NotApplicable,
    SensorSubject,
    as_json,
    check_parameters,
    must_refuse,
    require,
)

ASIDE_MM = 3.0
"""Distance from the apex at which the direction of a contact is checked."""

Array = npt.NDArray[np.float64]


def target(subject: SensorSubject) -> None:
    """The class behind the spec loads, inherits from tactibench.Sensor, and builds."""
    _ = subject.unopened


def parameters(subject: SensorSubject) -> None:
    """A sensor builds with every bound and choice of a parameter, or refuses the value in words."""
    check_parameters(subject.spec, subject.values, subject.build)


def context_manager(subject: SensorSubject) -> None:
    """`with` gives something to press, passes on what is raised inside, and can be entered anew."""
    sensor = subject.build()
    with sensor as opened:
        require(opened is not None, "__enter__ returned None")
        first = opened.press(subject.scenes[0])
    mishap = UserError("raised inside, and not swallowed.")
    caught = None
    try:
        with sensor:
            raise mishap
    except UserError as error:
        caught = error
    require(caught is mishap, "__exit__ swallowed an exception raised inside")
    with sensor as opened:
        again = opened.press(subject.scenes[0])
    require(again.signal.shape == first.signal.shape, "its frames have another shape")


def frames(subject: SensorSubject) -> None:
    """A press gives a frame of the declared kind and of one shape, with the pose pressed.

    Images are uint8, (H, W) or (H, W, 3); channels are finite float32 of any shape.
    """
    pressed = subject.press(*subject.scenes)
    for frame, scene in zip(pressed, subject.scenes, strict=True):
        require(isinstance(frame, Frame), f"press gave a {type(frame).__name__}, no Frame")
        _require_kind(frame, subject.unopened.signal)
        shape = frame.signal.shape
        first_shape = pressed[0].signal.shape
        require(shape == first_shape, f"shapes {first_shape} and {shape}")
        if frame.rest is not None:
            require(frame.rest.shape == shape, f"rest {frame.rest.shape}, signal {shape}")
        if subject.spec.origin == "simulated":
            require(frame.pose == scene.pose, f"{scene.pose} was pressed, {frame.pose} is said")
    signals = [frame.signal for frame in pressed]
    require(
        not all(np.array_equal(signal, signals[0]) for signal in signals[1:]),
        f"{len(signals)} different presses gave the same frame",
    )


def _require_kind(frame: Frame, signal: str) -> None:
    """Raise Failed for a frame that is not of the kind that its sensor declares."""
    kind, shape = frame.signal.dtype, frame.signal.shape
    if signal == CHANNELS:
        require(kind == np.float32, f"signal is 'channels', but holds {kind}, no float32")
        require(frame.signal.size and np.isfinite(frame.signal).all(), f"{shape}, not all finite")
        return
    require(kind == np.uint8, f"signal is 'image', but holds {kind}, no uint8")
    is_image = len(shape) == 2 or (len(shape) == 3 and shape[2] == 3)
    require(is_image and frame.signal.size, f"an image of shape {shape}")


def rest_frame(subject: SensorSubject) -> None:
    """The rest frame is of the shape of a press, has depth 0, and a press does not change it."""
    with subject.build() as sensor:
        try:
            before = sensor.rest()
        except UserError as error:
            raise NotApplicable(f"it has no rest frame ({error})") from None
        press = sensor.press(subject.scenes[0])
        after = sensor.rest()
    shape = press.signal.shape
    _require_kind(before, subject.unopened.signal)
    require(before.signal.shape == shape, f"rest {before.signal.shape}, press {shape}")
    require(before.pose.depth <= 0, f"the rest frame has a depth of {before.pose.depth} mm")
    drift, moved = _change(after, before).mean(), _change(press, before).mean()
    require(drift < 0.5 * moved, f"after a press, rest differs by {drift:.3g}, a press {moved:.3g}")


def deeper(subject: SensorSubject) -> None:
    """Depths are mm: at the apex, a tip pressed deeper changes the frame more."""
    subject.skip_unless_any_scene()
    space = subject.protocol.workspace
    depths = np.linspace(max(1.0, space.depth_min_mm), min(5.0, space.depth_max_mm), 4)
    with subject.build() as sensor:
        rest = _gray(sensor.rest())
        levels = [
            float(np.abs(_gray(sensor.press(_tip(0, 0, float(depth)))) - rest).mean())
            for depth in depths
        ]
    shown = ", ".join(
        f"{level:.3g} at {depth:.2g} mm" for level, depth in zip(levels, depths, strict=True)
    )
    require(all(a < b for a, b in pairwise(levels)), f"mean change of the signal: {shown}")


def direction(subject: SensorSubject) -> None:
    """A contact 3 mm to the right (x) or down (y) changes the frame on that side."""
    subject.skip_unless_any_scene()
    if subject.unopened.signal != IMAGE:
        raise NotApplicable("channels have no sides")
    space = subject.protocol.workspace
    depth = 0.5 * (space.depth_min_mm + space.depth_max_mm)
    with subject.build() as sensor:
        rest = sensor.rest()
        left, right, up, down = (
            _centroid(_change(sensor.press(_tip(x, y, depth)), rest))
            for x, y in ((-ASIDE_MM, 0), (ASIDE_MM, 0), (0, -ASIDE_MM), (0, ASIDE_MM))
        )
    for axis, name, low, high in ((0, "x right", left, right), (1, "y down", up, down)):
        along, across = high[axis] - low[axis], high[1 - axis] - low[1 - axis]
        message = (
            f"6 mm along {name} moved the change by {along:.1f} px, and {across:.1f} px across"
        )
        require(along > 1.0 and along > 2 * abs(across), message)


def determinism(subject: SensorSubject) -> None:
    """Two sensors with the same seed see the same frames."""
    subject.skip_unless_repeatable()
    first, second = (subject.press(*subject.scenes, seed=7) for _ in range(2))
    _require_equal(first, second, "two sensors with the same seed")


def press_many(subject: SensorSubject) -> None:
    """press_many gives the frames that press would give, in order, of any iterable."""
    subject.skip_unless_repeatable()
    one_by_one = subject.press(*subject.scenes)
    with subject.build() as sensor:
        require(list(sensor.press_many([])) == [], "no scenes gave frames")
    with subject.build() as sensor:
        together = list(sensor.press_many(iter(subject.scenes)))
    _require_equal(one_by_one, together, "press and press_many")


def refusals(subject: SensorSubject) -> None:
    """A scene far too deep or not finite is refused, one far beside the sensor touches nothing."""
    wrong = {
        "a tip pressed 10 cm deep": _tip(0.0, 0.0, 100.0),
        "a scene at x = NaN": _tip(float("nan"), 0.0, 2.0),
        "a scene at infinite depth": _tip(0.0, 0.0, float("inf")),
    }
    own_scenes = subject.unopened.scenes()
    if own_scenes is not None:
        scene = subject.scenes[0]
        other = replace(scene, pose=replace(scene.pose, depth=scene.pose.depth + 0.0123))
        require(other not in own_scenes.values(), "the check found no scene that is not there")
        wrong["a scene that it does not have"] = other
    with subject.build() as sensor:
        for case, scene in wrong.items():
            with must_refuse(case):
                sensor.press(scene)
            with must_refuse(f"{case}, by press_many,"):
                list(sensor.press_many([scene]))
        press = sensor.press(subject.scenes[0])
        try:
            beside = sensor.press(_tip(100.0, 0.0, 2.0))
        except UserError:
            return
        rest = sensor.rest()
    beyond, touched = _change(beside, rest).mean(), _change(press, rest).mean()
    message = f"a tip 10 cm beside it changes the frame by {beyond:.3g}, a press by {touched:.3g}"
    require(beyond < 0.5 * touched, message)


def describe(subject: SensorSubject) -> None:
    """The description is JSON values, the same for equal parameters, before and after a press."""
    sensor = subject.build()
    before = as_json(sensor.describe(), "describe")
    with sensor as opened:
        opened.press(subject.scenes[0])
    require(as_json(sensor.describe(), "describe") == before, "a press changed the description")
    require(
        as_json(subject.build(seed=1).describe(), "describe") == before, "it depends on the seed"
    )


def surface(subject: SensorSubject) -> None:
    """A known surface is (H, W) of the grid, finite, and deepest within 2 mm of the contact."""
    subject.skip_unless_any_scene()
    grid = subject.protocol.grid.grid()
    surface = subject.unopened.surface(_tip(3.0, -2.0, 2.0), grid)
    if surface is None:
        raise NotApplicable("it knows no surface")
    depths = np.asarray(surface)
    require(depths.shape == grid.shape, f"shape {depths.shape}, expected {grid.shape}")
    require(np.isfinite(depths).all(), "it is not finite")
    row, column = np.unravel_index(int(depths.argmax()), depths.shape)
    x, y = grid.xy(int(row), int(column)).tolist()
    # On a dome the skin gives way inward along its normal, where the tip first touches.
    distance = np.hypot(x - 3.0, y + 2.0)
    require(distance <= 2.0, f"pressed at x 3, y -2 mm, it is deepest at x {x:.1f}, y {y:.1f} mm")


def _tip(x: float, y: float, depth: float) -> Scene:
    """Return a press by one spherical tip of 3 mm radius, at x, y and depth in mm."""
    return Scene(Indenter.single(), Pose(x, y, 0.0, 0.0, depth))


def _gray(frame: Frame) -> Array:
    """Return the (H, W) grey levels of an image, colours averaged, or the channels as they are."""
    levels = np.asarray(frame.signal, dtype=np.float64)
    return levels.mean(axis=2) if levels.ndim == 3 and not holds_channels([frame]) else levels


def _change(frame: Frame, rest: Frame) -> Array:
    """Return the squared change of every pixel or channel from the undeformed sensor."""
    return np.square(_gray(frame) - _gray(rest))


def _centroid(change: Array) -> tuple[float, float]:
    """Return column and row of the centroid of a change (H, W), px."""
    total = float(change.sum())
    rows, columns = np.indices(change.shape)
    return float((change * columns).sum() / total), float((change * rows).sum() / total)


def _require_equal(first: list[Frame], second: list[Frame], case: str) -> None:
    require(len(first) == len(second), f"{case}: {len(first)} and {len(second)} frames")
    for number, (frame, other) in enumerate(zip(first, second, strict=True), 1):
        require(np.array_equal(frame.signal, other.signal), f"{case} differ in frame {number}")
        require(frame.pose == other.pose, f"{case} differ in pose {number}")
