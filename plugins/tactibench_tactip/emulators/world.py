"""The world that the emulators share: a tool over a simulated sensor, in time.

Nothing runs in the background: motion up to now is computed, in the order of the world's time,
whenever a device or another caller asks.
"""

from __future__ import annotations

import math
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from itertools import count, takewhile
from threading import RLock

import numpy as np
import numpy.typing as npt

from tactibench import Indenter, Scene, Sensor, SensorContext, UserError, open_sensor
from tactibench.geometry import DOME_RADIUS_MM
from tactibench_tactip.emulators.device import Fault, FaultEvent
from tactibench_tactip.emulators.motion import Array, Move, Pose6, matrix, pose6
from tactibench_tactip.emulators.touch import Rig, Touch, Truth
from tactibench_tactip.emulators.watch import Envelope, Watch

Image = npt.NDArray[np.uint8]
FaultHandler = Callable[[Fault, float], None]
"""A function of a fault and of the time of the world, s, at which it happens."""

SAMPLE_S = 1e-3
"""Time between two samples of a move. Between them, a curve of 500 mm/s2 leaves its chord by
a t^2 / 8 = 0.06 micrometres."""
PRESS_DEPTH_MM = 0.4
"""A contact that gets deeper than this is a press; a search for first touch stays shallower."""
MOVES, EXCURSIONS, IMAGES = 4096, 1000, 64
"""Numbers of moves, exits from the envelope and images that are remembered at most, so that memory
does not grow in long collections."""


class Clock:
    """The clock of the world, which runs ``scale`` times as fast as the host's."""

    def __init__(self, scale: float = 1.0) -> None:
        self.scale = scale
        self._start = time.monotonic_ns()

    def now(self) -> float:
        """Return the present time of the world, s since the clock was made."""
        return self.at(time.monotonic_ns())

    def at(self, monotonic_ns: int) -> float:
        """Return the time of the world, s, at a reading of ``time.monotonic_ns``."""
        return (monotonic_ns - self._start) * 1e-9 * self.scale


def simulated(name: str) -> Sensor:
    """Return a sensor of any installed plugin, without its own noise.

    The noise is switched off where the sensor has a parameter ``noise``: the emulated camera adds
    noise to every frame.

    Args:
        name: Name of the sensor.

    Raises:
        UserError: The sensor is unknown.
    """
    context = SensorContext(np.random.SeedSequence(0))
    return open_sensor(name, context, {}, preferred={"noise": "false"})


class World:
    """A tool that moves over a sensor; it may be used from several threads.

    Attributes:
        clock: The clock of the world.
        rig: The true geometry of the setup.
        lock: Lock that is held by every caller that changes the world.
        rest: (H, W) uint8 image of the undeformed sensor, without noise.
        excursions: Time, s, and tool pose for every time that the tool left the envelope.
        fired: The faults that happened, in order.
    """

    def __init__(
        self,
        sensor: Sensor,
        rig: Rig | None = None,
        *,
        faults: Iterable[Fault] = (),
        clock: Clock | None = None,
    ) -> None:
        """Place the tool at the start of the rig and arm the faults.

        Args:
            sensor: An open sensor with a camera.
            rig: Geometry of the setup; None: the default one.
            faults: Faults to arm.
            clock: Clock of the world; None: one in real time.
        """
        self.lock = RLock()
        self.clock = clock or Clock()
        self.rig = rig or Rig()
        self.rest = _read_only(sensor.rest().image)
        self.excursions: list[tuple[float, Pose6]] = []
        self.fired: list[FaultEvent] = []
        self._sensor = sensor
        self._images: OrderedDict[Scene, Image] = OrderedDict()
        self._image_lock = RLock()
        dome = sensor.dome_radius_mm
        self._touch = Touch(self.rig, DOME_RADIUS_MM if dome is None else dome)
        self._envelope: Envelope | None = None
        self._inside = True
        self._moves: deque[Move] = deque(maxlen=MOVES)
        self._moves.append(Move.rest(-math.inf, matrix(self.rig.start)))
        self._computed_s = 0.0
        self._numbers = count()
        self._watches: dict[int, Watch] = {}
        self._handlers: dict[str, list[FaultHandler]] = {}
        self._armed: list[Fault] = []
        self._fault_watches: list[int] = []
        self._begun = 0
        self._pressing = False
        self._watch_press()
        self.arm(*faults)

    # State for callers

    @property
    def presses(self) -> int:
        """Number of presses that have begun."""
        with self.lock:
            self.advance()
            return self._begun

    def tool(self) -> Pose6:
        """Return the present pose of the tool in the work frame."""
        return pose6(self._pose_now())

    def truth(self, at_ns: int | None = None) -> Truth:
        """Return the state of the world now, or at a ``time.monotonic_ns``.

        Raises:
            ValueError: That moment is no longer remembered.
        """
        return self._touch.truth(self._pose_now(at_ns))

    def image(self, at_ns: int | None = None) -> Image:
        """Return the read-only image (H, W) or (H, W, 3) of the sensor, without noise.

        Where a press is deeper or steeper than the sensor allows, it is drawn less deep.
        """
        return self._image_of(self.truth(at_ns).scene)

    def image_at(self, t: float) -> Image:
        """Return the image, as ``image`` does, at ``t`` s of the world."""
        return self._image_of(self._touch.truth(self.pose_at(t)).scene)

    def _image_of(self, scene: Scene | None) -> Image:
        """Return the image of a scene; poses are rounded, so that a held press is drawn once."""
        if scene is None:
            return self.rest
        key = _rounded(scene)
        with self._image_lock:
            if key not in self._images:
                self._images[key] = self._draw(key)
                if len(self._images) > IMAGES:
                    self._images.popitem(last=False)
            self._images.move_to_end(key)
            return self._images[key]

    # Changes of the rig

    def mount(self, indenter: Indenter) -> None:
        """Change the indenter."""
        with self.lock:
            self.advance()
            self.rig = replace(self.rig, indenter=indenter)
            self._touch = Touch(self.rig, self._touch.dome_radius)

    def keep_to(self, envelope: Envelope | None) -> None:
        """Note every motion outside this envelope from now on; None: the tool may go anywhere."""
        with self.lock:
            self.advance()
            self._envelope, self._inside = envelope, True

    def arm(self, *faults: Fault) -> None:
        """Arm faults; a fault without a press happens now."""
        with self.lock:
            now = self.advance()
            for fault in faults:
                if fault.press is None:
                    self._fire(fault, now)
                else:
                    self._armed.append(fault)
                    if self._pressing:
                        self._watch_faults()

    def on_fault(self, handlers: Mapping[str, FaultHandler]) -> None:
        """Add handlers of a device: kind of a fault -> function that acts on it."""
        with self.lock:
            for kind, handler in handlers.items():
                self._handlers.setdefault(kind, []).append(handler)

    # Motion, for the devices; all calls are under ``lock``

    def pose_at(self, t: float) -> Array:
        """Return the (4, 4) tool pose in the work frame at ``t`` s, which may lie in the future.

        Raises:
            ValueError: That moment is no longer remembered.
        """
        for move in reversed(self._moves):
            if move.start_s <= t:
                return move.end if math.isinf(move.start_s) else move.pose(t)
        raise ValueError(f"where the tool was at {t:.3f} s is no longer kept")

    def move_at(self, t: float) -> Move | None:
        """Return the move that is made at ``t`` s; None: the tool stands still."""
        move = next((m for m in reversed(self._moves) if m.start_s <= t), None)
        return move if move is not None and t < move.end_s else None

    def follow(self, t: float, *moves: Move) -> None:
        """Replace the planned motion by moves from ``t`` s on; without a move, stop at once."""
        pose = self.pose_at(t)
        while self._moves[-1].start_s >= t:
            self._moves.pop()
        self._moves.extend(moves or [Move.rest(t, pose)])

    def brake(self, t: float, deceleration: float) -> float:
        """Brake to rest on the present line; return the time at which all motion ends, s.

        Args:
            t: Time at which braking begins, s.
            deceleration: Deceleration, mm/s2.
        """
        move = self.move_at(t)
        if move is not None:
            self.follow(t, move.braked(t, deceleration))
        return self.still_s

    @property
    def still_s(self) -> float:
        """Time at which the planned motion ends, s."""
        end = self._moves[-1].end_s
        return 0.0 if math.isinf(end) else end

    def depth(self, t: float) -> float:
        """Return the depth of the deepest tip at ``t`` s, mm; a negative depth is a gap."""
        return float(self._touch.depths(self.pose_at(t)[None]).max())

    def force(self, t: float) -> float:
        """Return the force at ``t`` s, N."""
        return float(self._touch.forces(self._touch.depths(self.pose_at(t)[None]))[0])

    def watch(self, watch: Watch) -> int:
        """Call back once when a level is passed; return a number for ``forget``."""
        number = next(self._numbers)
        self._watches[number] = watch
        return number

    def forget(self, number: int) -> None:
        """Drop a watch; a watch that was called is dropped already."""
        self._watches.pop(number, None)

    def advance(self) -> float:
        """Compute all that happened up to now, in order; return the present time, s."""
        with self.lock:
            now = self.clock.now()
            while self._computed_s < now:
                self._advance_along(self._computed_s, now)
            return now

    def _advance_along(self, start: float, now: float) -> None:
        """Advance to the first event after ``start``, to the end of its move, or to ``now``."""
        ahead = [m.start_s for m in takewhile(lambda m: m.start_s > start, reversed(self._moves))]
        move = self.move_at(start)
        end = min(now, *ahead, now if move is None else move.end_s)
        self._computed_s = end
        if move is None:
            return
        times = np.linspace(start, end, math.ceil((end - start) / SAMPLE_S) + 1)
        poses = move.poses(times)
        tips = self._touch.depths(poses)
        values = {"depth": tips.max(axis=1), "force": self._touch.forces(tips)}
        event: tuple[float, int] | None = None
        for number, watch in self._watches.items():
            t = watch.crossing(times, values[watch.quantity])
            if t is not None and (event is None or t < event[0]):
                event = t, number
        if event is not None:
            self._computed_s = event[0]
        self._record(times, poses)
        if event is not None:
            self._watches.pop(event[1]).notify(event[0])

    def _record(self, times: Array, poses: Array) -> None:
        """Record the exits from the envelope up to the computed time."""
        seen = times <= self._computed_s
        if self._envelope is None:
            return
        for k, inside in enumerate(self._envelope.holds(poses[seen])):
            if self._inside and not inside and len(self.excursions) < EXCURSIONS:
                self.excursions.append((float(times[k]), pose6(poses[k])))
            self._inside = bool(inside)

    # Presses and faults

    def _watch_press(self) -> None:
        self.watch(Watch("depth", PRESS_DEPTH_MM, self._begin_press))

    def _begin_press(self, _: float) -> None:
        self._begun += 1
        self._pressing = True
        self.watch(Watch("depth", 0.0, self._end_press, falling=True))
        self._watch_faults()

    def _end_press(self, _: float) -> None:
        self._pressing = False
        for number in self._fault_watches:
            self.forget(number)
        self._fault_watches.clear()
        self._watch_press()

    def _watch_faults(self) -> None:
        for fault in [fault for fault in self._armed if fault.press == self._begun]:
            self._armed.remove(fault)
            depth = max(fault.depth_mm, PRESS_DEPTH_MM + 1e-6)
            notify = partial(self._fire, fault)
            self._fault_watches.append(self.watch(Watch("depth", depth, notify)))

    def _fire(self, fault: Fault, t: float) -> None:
        handlers = self._handlers.get(fault.kind, [])
        self.fired.append(FaultEvent(fault, t, self._begun, bool(handlers)))
        for handler in handlers:
            handler(fault, t)

    def _pose_now(self, at_ns: int | None = None) -> Array:
        with self.lock:
            now = self.advance()
            return self.pose_at(now if at_ns is None else min(self.clock.at(at_ns), now))

    def _draw(self, scene: Scene) -> Image:
        for shallower in _shallower(scene):
            try:
                return _read_only(self._sensor.press(shallower).image)
            except UserError:  # deeper or steeper than this sensor can show
                continue
        return self.rest


def _shallower(scene: Scene) -> Iterator[Scene]:
    """Yield the scene, and then the scene less and less deep, each time by a twentieth."""
    for _ in range(60):
        yield scene
        scene = replace(scene, pose=replace(scene.pose, depth=scene.pose.depth * 0.95))


def _read_only(image: Image) -> Image:
    result = image.copy()
    result.setflags(write=False)
    return result


def _rounded(scene: Scene) -> Scene:
    pose = scene.pose
    names = ("x", "y", "yaw", "tilt", "depth")
    values = {name: round(getattr(pose, name) / 1e-3) * 1e-3 for name in names}
    return Scene(scene.indenter, replace(pose, **values))
