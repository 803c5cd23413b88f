"""A robot, a camera and a clock of a program's own: hours pass in seconds, and faults come in time.

One thread does all. Whoever waits moves the clock on, and the camera's frames come meanwhile.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from fake_station import FIXED_TOUCH, TRUE_Z0, FakeCapture, FakeRobot, make_settings, stand_in

from tactibench import UserError
from tactibench.datasets import open_dataset
from tactibench_tactip import (
    Callbacks,
    Camera,
    CameraSettings,
    CollectionPlan,
    Mover,
    Pose6,
    PositionUnknownError,
    RobotLostError,
    RobotState,
    SessionReport,
    Settings,
    collect,
    configure,
    move_seconds,
)

MODULES = ("camera", "station", "motion", "collection", "touch")
FPS = 30.0
KEPT = 300
"""Frames that a lag can show again."""
TICK_S = 0.02
"""Period of the control loop, which costs most of the time."""


class Clock:
    """A module ``time`` whose time passes where somebody waits.

    Attributes:
        now_s: Time.
        at_tick: Called at every frame's time.
        events: (time, function) to come, sorted.
    """

    def __init__(self) -> None:
        self.now_s, self.frame_s = 1000.0, 1000.0
        self.period_s = 1.0 / FPS
        self.at_tick: Callable[[], None] = lambda: None
        self.events: list[tuple[float, Callable[[], None]]] = []

    def monotonic(self) -> float:
        return self.now_s

    def monotonic_ns(self) -> int:
        return int(1e9 * self.now_s)

    def sleep(self, seconds: float) -> None:
        end = self.now_s + seconds
        while self.frame_s <= end:
            self.now_s, self.frame_s = self.frame_s, self.frame_s + self.period_s
            while self.events and self.events[0][0] <= self.now_s:
                self.events.pop(0)[1]()
            self.at_tick()
        self.now_s = max(end, self.now_s)


class VirtualRobot(FakeRobot):
    """Moves along straight lines at their speed.

    Attributes:
        sideways: Lower end of every sideways move, mm of the work frame.
        deepest_mm: Of all poses that it had.
        moves_made: Of all sessions.
    """

    def __init__(self, settings: Settings, clock: Clock) -> None:
        super().__init__(settings)
        self.clock = clock
        self.way = [(0.0, 0.0, self.at, self.at)]
        self.lost, self.unknown = False, ""
        self.moves_made: list[Pose6] = []
        self.deepest_mm = -99.0
        self.sideways: list[float] = []

    def start(self, pose: Pose6, speed: float, acceleration: float) -> None:
        self.at, start = self.pose(), self.clock.now_s
        before, seconds = self.tool(), move_seconds(self.at, pose, speed, acceleration)
        self.way = [*self.way[-40:], (start, start + seconds, self.at, pose)]
        self.moves.append(pose)
        self.moves_made.append(pose)
        self.at = pose
        after = self.tool()
        if max(abs(a - b) for a, b in zip(before[:2], after[:2], strict=True)) > 0.02:
            self.sideways.append(max(before[2], after[2]))
        self.at = self.pose()

    def pose_at(self, time_s: float) -> Pose6:
        began, ended, a, b = next((w for w in self.way[::-1] if w[0] <= time_s), self.way[0])
        share = 1.0 if time_s >= ended else max(0.0, time_s - began) / max(1e-9, ended - began)
        return tuple(p + share * (q - p) for p, q in zip(a, b, strict=True))  # type: ignore[return-value]

    def pose(self) -> Pose6:
        if self.lost:
            raise RobotLostError("the link is gone; check the cable.")
        if self.unknown:
            raise PositionUnknownError(f"the position of the stage is not known: {self.unknown}.")
        self.at = self.pose_at(self.clock.now_s)
        self.deepest_mm = max(self.deepest_mm, self.tool()[2])
        return self.at

    def moving(self) -> bool:
        return self.clock.now_s < self.way[-1][1]

    def stop(self) -> None:
        here = self.pose_at(self.clock.now_s)
        self.stops += 1
        self.way.append((self.clock.now_s, self.clock.now_s, here, here))

    def resist(self, n_per_mm: float | None) -> None:
        """Let the sensor be as stiff as something that is in the way."""
        self.stiffness = n_per_mm

    def protect(self) -> None:
        """Stop, as a controller does to protect somebody."""
        self.normal, self.stopped = False, True
        self.stop()

    def state(self) -> RobotState:
        self.pose()
        return super().state()


class VirtualCapture(FakeCapture):
    """Frames of a sensor under a ``VirtualRobot``, with faults that may begin at any time.

    Attributes:
        lag_s: Time by which a frame comes late. A camera cannot look back: of what it showed before
            its lag began it sends the same frames again.
        fault: "freeze", "double" (each frame twice), "ring" (four frames for ever), "shrink"
            (to two thirds), "slow" (8 a second), "half" (15 a second), "mirror" (as another camera
            shows it), "dark", "bright", "hang" (no frames), "cut"; or none, "".
    """

    lag_s, fault, count = 0.0, "", 0

    def __init__(self, robot: VirtualRobot) -> None:
        super().__init__(robot)
        self.sent: list[Any] = []
        self.taken: dict[int, Any] = {}
        self.depths: dict[Pose6, float] = {}

    def depth(self) -> float:
        assert isinstance(self.robot, VirtualRobot)
        robot = self.robot
        robot.at = pose = robot.pose_at(self.exposed() / FPS)
        if pose not in self.depths:
            self.depths = {pose: super().depth()}
        return self.depths[pose]

    def exposed(self) -> int:
        """Number of the frame's exposure: the last tick that is ``lag_s`` ago."""
        assert isinstance(self.robot, VirtualRobot)
        return math.floor((self.robot.clock.now_s - self.lag_s) * FPS + 0.25)

    def grab(self) -> bool:
        return self.fault != "cut"

    def comes(self) -> bool:
        """Whether there is a frame at this tick."""
        self.count += 1
        return self.fault != "hang" and self.count % {"slow": 4, "half": 2}.get(self.fault, 1) == 0

    def retrieve(self) -> tuple[bool, Any]:
        if self.sent:
            if self.fault == "freeze" or (self.fault == "double" and self.count % 2):
                return True, self.sent[-1]
            if self.fault == "ring":
                return True, self.sent[self.count % len(self.sent)]
        number = self.exposed()
        if number not in self.taken:
            self.taken[number] = super().retrieve()[1]
            self.taken.pop(number - KEPT, None)
        image = self.taken[number]
        if self.fault in ("dark", "bright"):
            image = (image * (0.7 if self.fault == "dark" else 1.3)).clip(0, 255).astype(np.uint8)
        if self.fault == "shrink":
            image = image[:32, :32]
        if self.fault == "mirror":
            image = image[:, ::-1]
        self.sent = [*self.sent[-3:], image]
        return True, image


class VirtualCamera(Camera):
    """A camera that is read by whoever waits."""

    def __init__(self, settings: CameraSettings, clock: Clock, capture: VirtualCapture) -> None:
        super().__init__(settings, lambda _: capture)
        self.clock, self.capture = clock, capture
        self._news = _Turns(clock)  # type: ignore[assignment]

    check_rate = Camera.check_rate  # also where a test lets every rate pass

    def _begin(self) -> None:
        self._run, self._failure, self._taken_ns = self._run + 1, "", 0
        self._frames.clear()
        self._started_ns = self.clock.monotonic_ns()
        self.read_back = self.read_back or configure(self.capture, self._settings)
        self.clock.at_tick = self._tick

    def _tick(self) -> None:
        if self.capture.comes() and not self._failure:
            self._take(self.capture, self._run)


class _Turns:
    """What a camera waits with: its frames come while it waits."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock

    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None: ...

    def notify_all(self) -> None: ...

    def wait(self, seconds: float) -> None:
        self._clock.sleep(min(seconds, self._clock.period_s))


class _SameThread:
    """Stands in for ``RobotThread``: the caller does the robot's jobs."""

    def __init__(self, robot: Any, settings: Settings) -> None:
        self.robot, self.halt = robot, threading.Event()
        self.mover = Mover(robot, settings, self.halt)

    def __enter__(self) -> Self:
        self.robot.connect()
        return self

    def __exit__(self, *_: object) -> None:
        self.robot.close()

    def do(self, job: Callable[[Mover], Any]) -> Any:
        return job(self.mover)


@dataclass
class Session:
    """How a session ended: its report, or the sentence of its error."""

    report: SessionReport | None
    said: str


class VirtualLab:
    """Collects a plan with virtual devices.

    Attributes:
        robot: Robot of the present session; the sensor stays as it is.
        capture: What the camera sends.
    """

    def __init__(self, folder: Path, patch: Any, plan: CollectionPlan, **tables: Any) -> None:
        self.folder, self.plan, self.clock = folder, plan, Clock()
        camera = {"fps": FPS, "warmup_frames": 60, "lag_s": 0.1} | tables.pop("camera", {})
        defaults = {"contact": FIXED_TOUCH, "timing": {"settle_s": 0.2}, "camera": camera}
        self.tables = defaults | tables
        self.settings = make_settings(**self.tables)
        self.robot = VirtualRobot(self.settings, self.clock)
        self.capture = VirtualCapture(self.robot)
        for name in MODULES:
            patch.setattr(f"tactibench_tactip.{name}.time", self.clock)
        patch.setattr("tactibench_tactip.station.RobotThread", _SameThread)
        patch.setattr("tactibench_tactip.motion.TICK_S", TICK_S)
        stand_in(self._connect, patch)

    def _connect(self, settings: Settings) -> VirtualRobot:
        """Return the same arm, where it was left."""
        old, self.robot = self.robot, VirtualRobot(settings, self.clock)
        self.robot.way, self.robot.sideways = old.way, old.sideways
        self.robot.deepest_mm, self.robot.moves_made = old.deepest_mm, old.moves_made
        self.capture.robot = self.robot
        make = self.robot
        make.camera = lambda keys: VirtualCamera(keys, self.clock, self.capture)  # type: ignore[method-assign]
        return make

    def session(self) -> Session:
        """Collect once, as the same command does again and again."""
        try:
            report = collect(self.settings, self.plan, self.folder, callbacks=Callbacks())
        except (UserError, OSError) as error:
            notes = getattr(error, "__notes__", ())
            return Session(None, " ".join([str(error), *notes]))
        return Session(report, "")

    def later(self, seconds: float, do: Callable[[], None]) -> None:
        """Do something after a time."""
        event = (self.clock.now_s + seconds, do)
        self.clock.events = sorted([*self.clock.events, event], key=lambda item: item[0])

    def statuses(self) -> set[str]:
        """Return those of the samples that were written."""
        return {sample.status for sample in self.samples()}

    def samples(self) -> tuple[Any, ...]:
        """Return what was written."""
        there = (self.folder / "metadata.jsonl").exists()
        return tuple(open_dataset(self.folder).samples) if there else ()

    def wrong_samples(self, within_mm: float = 0.1) -> list[tuple[int, float, float]]:
        """Return id, label and depth shown, mm, of good samples whose label their frame belies."""
        wrong, samples = [], self.samples()
        dataset = open_dataset(self.folder) if samples else None
        for sample in samples:
            if sample.status == "ok" and sample.scene is not None:
                change = np.asarray(dataset.signal(sample), float) - self.capture.rest
                pattern = self.capture.pattern
                shown = float((change * pattern).sum() / (pattern**2).sum()) / 0.1
                if abs(shown - sample.scene.pose.depth) > within_mm:
                    wrong.append((sample.id, sample.scene.pose.depth, shown))
        return wrong

    def unsafe(self) -> list[str]:
        """Return what the arm did that it must not."""
        clear = TRUE_Z0 - self.settings.envelope.clearance_mm + 0.1
        planned = max(press.scene.pose.depth for press in self.plan.presses) + TRUE_Z0
        low = [f"sideways at z {z:.1f} mm" for z in self.robot.sideways if z > clear]
        deepest = self.robot.deepest_mm
        return low + [f"{deepest:.1f} mm deep"] * int(deepest > planned + 0.5)
