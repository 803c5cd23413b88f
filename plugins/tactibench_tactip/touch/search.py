"""Finding first touch: by the tactile image, by force, by a probe, or as the configuration says.

Depth is counted from where the sensor is first touched, not from where a pose says that it should
be. By the image: down in small steps until frames change by more than noise, twice in a row; then,
from before that place, a ramp of steps of which the change of every frame is measured along the
change of the deepest one. The change begins at first touch and grows with a power of the depth: the
begin of the best such curve is first touch, well below the step and the threshold of detection.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tactibench import Pose, Scene, UserError
from tactibench_tactip.failures import RobotError, TrippedError
from tactibench_tactip.motion import press_moves
from tactibench_tactip.motion.mover import Guard, Mover
from tactibench_tactip.robots.base import Probes
from tactibench_tactip.settings import Pose6
from tactibench_tactip.station import Station
from tactibench_tactip.touch.ramp import onset, projections

STEP_MM = 0.1
BEFORE_MM, BEYOND_MM = 0.25, 0.6
"""Of the ramp, around the place at which the change was noticed."""
FRAMES = 3
AGAIN_MM = 1.0
"""How far before the last first touch a later search begins."""


@dataclass(frozen=True)
class Touch:
    """z0_mm: of first touch along the work frame's z. spread_mm: between two searches. power: with
    which the change grew; 0 where none was measured."""

    z0_mm: float
    spread_mm: float
    method: str
    power: float = 0.0


class NoTouchError(RobotError):
    """Nothing was touched."""


@dataclass(frozen=True)
class Approach:
    """Where a search goes down. guard: against the force before the search, when nothing was
    touched: one that were made at every step would not see a force that grows with the steps."""

    station: Station
    place: Scene
    guard: Guard


def find_touch(station: Station, *, first: bool, scene: Scene | None = None) -> Touch:
    """Find first touch and take it over into the station's geometry.

    first: search all of ``contact.travel_mm``; otherwise from a little before the last one.
    scene: at this place, else at ``contact.at_mm``. Raises NoTouchError, and UserError when two
    searches differ by more than ``contact.spread_mm``.
    """
    keys = station.settings.contact
    place = scene or _canary(station)
    if keys.method == "fixed":
        return Touch(keys.fixed_mm, 0.0, "fixed")
    search = {"visual": _visual, "force": _force, "probe": _probe}[keys.method]
    start = -keys.travel_mm if first else -AGAIN_MM
    with station.at(place):
        way = Approach(station, place, station.do(lambda m: _untouched(m, station)))
        one, power = search(way, start)
        two, _ = search(way, one - AGAIN_MM)
        station.do(lambda m: press_moves.withdraw(m, place, station.geometry, station.settings))
    if abs(one - two) > keys.spread_mm:
        raise UserError(
            f"two searches for first touch differ by {abs(one - two):.2f} mm, contact.spread_mm "
            f"allows {keys.spread_mm:g}; tighten the mounts, let the light warm up, or lengthen "
            "timing.settle_s."
        )
    z0 = station.geometry.z0 + 0.5 * (one + two)
    station.geometry = station.geometry.with_z0(z0)
    return Touch(z0, abs(one - two), keys.method, power)


def _canary(station: Station) -> Scene:
    x, y = station.settings.contact.at_mm
    return Scene(station.settings.indenter.indenter(), Pose(x, y))


def _untouched(mover: Mover, station: Station) -> Guard:
    press_moves.raise_straight(mover, station.geometry, station.settings)
    return press_moves.force_guard(mover, station.settings.envelope.max_force_n)


def _visual(way: Approach, start: float) -> tuple[float, float]:
    """Depth, in what the geometry counts now, at which the image begins to change; its power."""
    station = way.station
    noticed = _until(way, start, _seen(station))
    depths, images = [], []
    steps = np.arange(noticed - BEFORE_MM - STEP_MM, noticed + BEYOND_MM + 1e-9, STEP_MM)
    station.do(lambda m: _step(m, way, float(steps[0]) - 0.2))
    for depth in steps:
        reached, shots = _look(way, float(depth), FRAMES)
        depths.append(reached)
        images.append(np.mean(shots, axis=0))
    rest = station.rest
    assert rest is not None, "looked at before"  # noqa: S101
    found = onset(np.array(depths), projections(np.array(images), rest.mean))
    return found.at_mm, found.power


def _seen(station: Station) -> Callable[[float, list[np.ndarray]], bool]:
    rest = station.rest or station.look_at_rest()

    def seen(_: float, images: list[np.ndarray]) -> bool:
        return all(rest.change_of(image) > rest.threshold for image in images)

    return seen


def _force(way: Approach, start: float) -> tuple[float, float]:
    station = way.station
    station.do(lambda m: press_moves.raise_straight(m, station.geometry, station.settings))
    before = station.do(lambda m: m.force())
    if before is None:
        raise UserError(
            "contact.method is 'force', but this robot measures none; say contact.method = "
            '"visual".'
        )
    most = station.settings.contact.force_n

    def felt(_: float, __: list[np.ndarray]) -> bool:
        now = station.do(lambda m: m.force())
        return now is not None and float(np.linalg.norm(now - before)) >= most

    return _until(way, start, felt), 0.0


def _probe(way: Approach, start: float) -> tuple[float, float]:
    station, place = way.station, way.place
    robot = station.owner.robot
    if not isinstance(robot, Probes):
        raise UserError(
            "contact.method is 'probe', which needs a stage with GRBL and a probe; say "
            'contact.method = "visual".'
        )
    end = _last(station, start)

    def down(mover: Mover) -> Pose6 | None:
        _step(mover, way, start)
        target = station.geometry.at_depth(place, end)
        return mover.probe(target, station.settings.robot.press_mm_s, way.guard)

    met = station.do(down)
    if met is None:
        raise NoTouchError(_nothing(start, end))
    return station.geometry.reached(place, met).pose.depth, 0.0


def _until(
    way: Approach, start: float, touched: Callable[[float, list[np.ndarray]], bool]
) -> float:
    """Down in steps until touched."""
    station = way.station
    end = _last(station, start)
    station.do(lambda m: press_moves.raise_straight(m, station.geometry, station.settings))
    for depth in np.arange(start, end + 1e-9, STEP_MM):
        reached, images = _look(way, float(depth), 2)
        if touched(reached, images):
            return reached
    raise NoTouchError(_nothing(start, end))


def _last(station: Station, start: float) -> float:
    return max(station.settings.contact.travel_mm, start + AGAIN_MM)


def _nothing(start: float, end: float) -> str:
    return (
        f"nothing was touched from {-start:.1f} mm before the expected place to {end:.1f} mm "
        "beyond it; check frames.work_frame and frames.tcp_pose, or allow more with "
        "contact.travel_mm."
    )


def _look(way: Approach, depth: float, count: int) -> tuple[float, list[np.ndarray]]:
    """Go to a depth, settle, and look: the depth reached and frames."""
    station, place = way.station, way.place

    def there(mover: Mover) -> tuple[int, float]:
        _step(mover, way, depth)
        mover.rest(station.settings.timing.settle_s)
        reached = station.geometry.reached(place, mover.pose())
        return time.monotonic_ns(), reached.pose.depth

    settled_ns, reached = station.do(there)
    return reached, [shot.image for shot in station.camera.after(settled_ns, count)]


def _step(mover: Mover, way: Approach, depth: float) -> None:
    """Straight to a depth on the approach of a place, sideways only at clearance."""
    settings, geometry, place = way.station.settings, way.station.geometry, way.place
    target = geometry.at_depth(place, depth)
    here = geometry.reached(place, mover.pose())
    if abs(here.pose.x - place.pose.x) > 0.2 or abs(here.pose.y - place.pose.y) > 0.2:
        press_moves.raise_straight(mover, geometry, settings)
        above = replace(press_moves.way(place, geometry, settings)).above
        mover.go(above, settings.robot.approach_mm_s)
    near = geometry.at_depth(place, min(depth, -press_moves.NEAR_MM))
    if here.pose.depth < -settings.contact.travel_mm - 0.5 and depth > -press_moves.NEAR_MM:
        mover.go(near, settings.robot.approach_mm_s, way.guard)
    mover.go(target, settings.robot.press_mm_s, way.guard)
    reason = way.guard(mover.pose())  # a step may have ended before the guard looked
    if reason:
        raise TrippedError(reason)
