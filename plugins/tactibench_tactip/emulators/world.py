"""The shared world: a tool over a simulated sensor, in scaled time."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from itertools import count
from threading import RLock
from types import TracebackType
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from tactibench import Indenter, Sensor, SensorContext, open_sensor
from tactibench.geometry import DOME_RADIUS_MM
from tactibench_tactip.emulators.clock import Clock
from tactibench_tactip.emulators.faults import Fault, Fired
from tactibench_tactip.emulators.levels import Level
from tactibench_tactip.emulators.log import Envelope, Log
from tactibench_tactip.emulators.motion import Leg, Profile
from tactibench_tactip.emulators.poses import Array, Pose6, matrix, pose6
from tactibench_tactip.emulators.recorder import Recorder
from tactibench_tactip.emulators.rig import Rig, Truth
from tactibench_tactip.emulators.route import Route
from tactibench_tactip.emulators.touch import Touch
from tactibench_tactip.emulators.view import View

Handler = Callable[[Fault, float], None]


def simulated(name: str = "tactip-127", *, seed: int = 0, **parameters: Any) -> Sensor:
    """The sensor of that name, of whichever installed plugin; parameters as on the command line.

    Its own noise is switched off where it has a parameter ``noise``: a camera has noise of its own
    in every frame, which ``CameraEmulator`` adds. Raises UserError as the plugin host does.
    """
    given = {key: str(value) for key, value in parameters.items()}
    context = SensorContext(np.random.SeedSequence(seed))
    return open_sensor(name, context, given, preferred={"noise": "false"})


class World:
    """A tool that moves over a sensor. Thread-safe; nothing ticks: what happened is worked out, in
    order, when somebody asks or a device looks.

    clock, log, rig: what they are called. lock: held by whoever changes something.
    """

    def __init__(
        self,
        sensor: Sensor,
        rig: Rig | None = None,
        *,
        envelope: Envelope | None = None,
        time_scale: float = 1.0,
        press_depth_mm: float = 0.4,
        faults: tuple[Fault, ...] = (),
        clock: Clock | None = None,
    ) -> None:
        """envelope None: everything is inside. press_depth_mm: a press is a time from touch to
        release in which the tool goes deeper than this; a search for first touch is none. clock:
        instead of one of ``time_scale``."""
        self.lock = RLock()
        self.clock = clock or Clock(time_scale)
        self.rig = rig or Rig()
        self.view = View(sensor)
        radius = None if sensor is None else sensor.dome_radius_mm
        self.dome_radius_mm = DOME_RADIUS_MM if radius is None else radius
        self._touch = Touch(self.rig, self.dome_radius_mm)
        self._route = Route(self._touch, matrix(self.rig.start))
        self._recorder = Recorder(self._route, envelope, press_depth_mm)
        self._known_s = 0.0
        self._levels: dict[int, Level] = {}
        self._timers: list[tuple[float, int, Callable[[float], None]]] = []
        self._number = count()
        self._handlers: dict[str, list[Handler]] = {}
        self._armed: list[Fault] = []
        self._fired: list[Fired] = []
        self.arm(*faults)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Nothing is held open."""

    # What somebody outside may ask

    @property
    def log(self) -> Log:
        return self._recorder.log

    @property
    def presses(self) -> int:
        """How many presses have begun."""
        with self.lock:
            self.advance()
            return self._recorder.presses

    def tool(self) -> Pose6:
        """Where the tool is now, work frame."""
        return pose6(self.pose())

    def truth(self, at_ns: int | None = None) -> Truth:
        """What is so now, or was at a ``time.monotonic_ns`` of the latest 4096 legs.

        Raises ValueError for a moment that is not kept."""
        return self._touch.truth(self.pose(at_ns))

    def truth_of(self, tool: Pose6) -> Truth:
        """What would be so with the tool there (work frame)."""
        return self._touch.truth(matrix(tool))

    def image(self, at_ns: int | None = None) -> npt.NDArray[np.uint8]:
        """(H, W) or (H, W, 3): the sensor as it is pressed, without a camera's noise; read-only.

        Deeper or steeper than the sensor can be pressed it shows the press that it still knows."""
        return self.view.image(self.truth(at_ns).scene)

    @property
    def fired(self) -> tuple[Fired, ...]:
        """Faults that happened, in order."""
        with self.lock:
            self.advance()
            return tuple(self._fired)

    # What somebody at the rig does

    def mount(self, indenter: Indenter) -> None:
        """Change the indenter."""
        with self.lock:
            self.advance()
            self.rig = replace(self.rig, indenter=indenter)
            self._touch = Touch(self.rig, self.dome_radius_mm)
            self._route.changed(self._touch)

    def keep_to(self, envelope: Envelope | None) -> None:
        """From now on the tool must stay in this envelope; None: it may go anywhere."""
        with self.lock:
            self.advance()
            self._recorder.envelope = envelope

    def arm(self, *faults: Fault) -> None:
        """Arm faults; one without a trigger happens now."""
        with self.lock:
            now = self.advance()
            for fault in faults:
                if fault.press is not None:
                    self._armed.append(fault)
                elif fault.at_s is not None:
                    self.alarm(fault.at_s, partial(self._fire, fault))
                else:
                    self._fire(fault, now)

    # What devices use; all of it under ``lock``

    def pose(self, at_ns: int | None = None) -> Array:
        """(4, 4) of the tool in the work frame, now or at a ``time.monotonic_ns``."""
        with self.lock:
            now = self.advance()
            return self._route.at(now if at_ns is None else min(self.clock.at(at_ns), now))

    def truth_at(self, t: float) -> Truth:
        """What is so at t s."""
        return self._touch.truth(self._route.at(t))

    def pose_at(self, t: float) -> Array:
        """(4, 4) of the tool in the work frame at t s, which may lie ahead as it is planned."""
        return self._route.at(t)

    def follow(self, t: float, steps: Iterable[tuple[Array, Profile]]) -> None:
        """From t (s, not before what is known) on, move the tool to (4, 4) poses in turn."""
        self._route.follow(t, steps)

    def leg(self, t: float) -> Leg | None:
        """What is travelled at t, None: the tool stands still."""
        return self._route.leg(t)

    def speed(self, t: float) -> tuple[float, Array]:
        """mm/s along the leg of t, and (3,) the tool point's way for each mm of it."""
        leg = self._route.leg(t)
        if leg is None or leg.line.length == 0:
            return 0.0, np.zeros(3)
        way = leg.line.end[:3, 3] - leg.line.start[:3, 3]
        return leg.speed(t), way / leg.line.length

    @property
    def still_s(self) -> float:
        """When the planned motion ends."""
        return self._route.end_s

    def depth(self, t: float) -> float:
        """Of the deepest tip, mm, at t s; negative: a gap."""
        return float(self._touch.depths(self._route.at(t)[None]).max())

    def force(self, t: float) -> float:
        """N, at t s."""
        return float(self._touch.forces(self._touch.depths(self._route.at(t)[None]))[0])

    def watch(self, level: Level) -> int:
        """Tell when a level is passed, once. Returns a number for ``forget``."""
        number = next(self._number)
        self._levels[number] = level
        return number

    def forget(self, number: int) -> None:
        self._levels.pop(number, None)

    def alarm(self, t: float, told: Callable[[float], None]) -> None:
        """Tell at t s."""
        heapq.heappush(self._timers, (t, next(self._number), told))

    def answer(self, kinds: Iterable[str], handler: Handler) -> None:
        """A device takes faults of these kinds."""
        with self.lock:
            for kind in kinds:
                self._handlers.setdefault(kind, []).append(handler)

    def advance(self) -> float:
        """Work out all that happened up to now, in order; returns now, s."""
        with self.lock:
            now = self.clock.now()
            while (found := self._next(now)) is not None:
                t, tell = found
                self._pass(t)
                tell(t)
            self._pass(now)
            return now

    def _pass(self, t: float) -> None:
        self._recorder.record(self._known_s, t)
        self._known_s = max(self._known_s, t)

    def _next(self, now: float) -> tuple[float, Callable[[float], None]] | None:
        """The first of timers and levels up to now."""
        found: tuple[float, Callable[[float], None]] | None = None
        if self._timers and self._timers[0][0] <= now:
            t, _, told = self._timers[0]
            found = max(t, self._known_s), partial(self._ring, told)
        levels = [*self._levels.items(), *self._recorder.levels(), *self._triggers()]
        for way in self._route.ways(self._known_s, now):
            leg = way.leg
            start, end = leg.way(max(self._known_s, leg.start_s)), leg.way(min(now, leg.end_s))
            for number, level in levels:
                at = way.crossing(level, start, end)
                t = now if at is None else max(leg.when(at), self._known_s)
                if at is not None and (found is None or t < found[0]):
                    found = t, partial(self._tell, number, level.told)
            if found is not None and found[0] <= leg.end_s:
                break
        return found

    def _ring(self, told: Callable[[float], None], t: float) -> None:
        heapq.heappop(self._timers)
        told(t)

    def _tell(self, number: int, told: Callable[[float], None], t: float) -> None:
        self.forget(number)
        told(t)

    def _triggers(self) -> Iterable[tuple[int, Level]]:
        """Levels of the faults whose press it is, or will be when it gets that deep."""
        for fault in self._armed:
            if fault.press is not None and self._recorder.is_press(fault.press):
                depth = max(fault.depth_mm, self._recorder.press_depth_mm + 1e-6)
                yield -1, Level("depth", depth, partial(self._trigger, fault))

    def _trigger(self, deepest: Fault, t: float) -> None:
        for fault in [f for f in self._armed if f.press == deepest.press]:
            if fault.depth_mm <= deepest.depth_mm:
                self._armed.remove(fault)
                self._fire(fault, t)

    def _fire(self, fault: Fault, t: float) -> None:
        handlers = self._handlers.get(fault.kind, [])
        self._fired.append(Fired(fault, t, self._recorder.presses, bool(handlers)))
        for handler in handlers:
            handler(fault, t)
